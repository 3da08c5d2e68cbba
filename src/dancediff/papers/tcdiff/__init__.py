"""TCDiff: group dance in two stages, paths over the floor first, bodies on them second."""
