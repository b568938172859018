"""Many grasps and whole motions at once, for planners."""
