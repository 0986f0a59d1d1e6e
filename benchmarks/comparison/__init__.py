"""The same small task in stepbus and its peers: `make comparison`."""
