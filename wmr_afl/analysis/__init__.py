"""What runs mean: metrics, excitation, stability, plots, animations."""
