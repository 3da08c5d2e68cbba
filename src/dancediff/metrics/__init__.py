"""Every metric of both papers and two of our own; `report` puts them in a table."""
