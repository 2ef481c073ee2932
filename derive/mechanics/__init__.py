"""How a robot moves: constraints, kinematics, mobility, dynamics."""
