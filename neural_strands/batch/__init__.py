"""Many subjects on one or many machines: every stage of every subject is a task that a Ray cluster runs."""
