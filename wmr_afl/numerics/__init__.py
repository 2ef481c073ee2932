"""Arrays for NumPy and CasADi alike; it knows no robot."""
