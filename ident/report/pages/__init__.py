"""One module a stage: what turns its result and its tables into a page of the report."""
