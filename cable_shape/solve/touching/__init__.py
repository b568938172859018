"""What solves for cables that lie on bodies and on each other."""
