"""FACT: a full-attention transformer that guesses the frames after a motion it is shown."""
