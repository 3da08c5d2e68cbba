"""What the papers say, and nothing else: one folder a paper."""
