"""What came before: models to compare with, trained by the same loop on the same data."""
