"""The ROS 2 side: parameters, conversions, inputs, diagnostics and the node. `fields` and `inputs` import no ROS."""
