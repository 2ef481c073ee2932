"""Build time: a robot description goes in, SymPy derives, NumPy and CasADi code comes out."""
