"""Robots that hold the cable: kinematics, inverse kinematics, steering."""
