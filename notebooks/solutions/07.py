"""Solutions of lesson 07."""

# %% 07.1
# Sorting tells who stands k-th. Sorting that order tells where in it everybody is found: the rank.
# The two are the same only for orders that are their own inverse, such as a plain exchange.


def ranks(root):
    order = root[:, 0, 0].argsort(stable=True)
    return order.argsort()
