"""The truck that made the sample logs: an independent truth, which shares no code with the pipeline."""
