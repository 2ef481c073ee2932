"""Generated models against a physics engine that nobody here wrote and that knows nothing of pseudo-velocities."""
