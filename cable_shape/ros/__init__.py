"""The ROS 2 side: parameters, conversions, inputs, diagnostics and the node."""
