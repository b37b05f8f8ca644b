"""Forward models: what a vehicle does, given its inputs and parameters."""
