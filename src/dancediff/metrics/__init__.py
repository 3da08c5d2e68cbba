"""Every metric of both papers and some of our own; `report` puts them in a table."""
