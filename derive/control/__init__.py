"""What a controller needs of a robot: linearization, base parameters, decoupling matrix."""
