"""What this project adds to the papers, one file each."""
