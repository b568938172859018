"""What messages carry, without ROS: their fields, their stamps, their frames."""
