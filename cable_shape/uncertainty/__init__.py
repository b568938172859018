"""What is not known of a cable, and the tube that follows from it."""
