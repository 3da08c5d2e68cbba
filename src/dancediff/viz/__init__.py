"""Pictures: stills (plots), films (video), the 3-D stage of the notebooks, and small panels.

matplotlib, av, ipywidgets and pythreejs are imported when a picture is asked for, not before.
"""
