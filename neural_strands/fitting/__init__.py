"""The fit of one capture: first strands, the optimisation loop, its losses and schedules."""
