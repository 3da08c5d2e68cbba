"""Building blocks of every network here: attention, FiLM, time steps, state space models."""
