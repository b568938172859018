"""Files that a user or a peer names, and the one loader of keys and values."""
