"""Systems side by side: trained for the same computing, dancing the same windows, scored alike."""
