"""LaTeX becomes MathML, which browsers draw themselves: no script, no font, no network."""

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util import logging

# What the converter does not know, said in a way that it does.
SAID_OTHERWISE = (
    (re.compile(r"\\(mathbb|mathcal)\s*(\w)"), r"\\\1{\2}"),  # a letter of its own, not a style
    (re.compile(r"\\arg\b"), r"\\operatorname{arg}"),
    (re.compile(r"(\\[bB]igg?[lr]?)\s*\\[lr]Vert\b"), r"\1\\|"),
)
# Browsers stretch bare bars to the height of the whole line, which TeX does only after ``\\left``.
BARE_BAR = re.compile(r"<mo>(&#x02016;|&#x0007C;|&#x0230[89AB];)</mo>")


def to_mathml(latex: str, display: str = "inline") -> str:
    """A ``<math>`` element.

    Raises: ValueError for what cannot be converted.
    """
    said = latex
    for pattern, otherwise in SAID_OTHERWISE:
        said = pattern.sub(otherwise, said)
    try:
        maths = convert(said, display=display)
    except Exception as err:  # the converter has many kinds, some without a base of their own
        raise ValueError(f"not converted: {latex!r} ({err!r})") from err
    if unknown := re.findall(r"\\\w+", maths):
        raise ValueError(f"unknown {', '.join(unknown)} in {latex!r}")
    return BARE_BAR.sub(r'<mo stretchy="false">\1</mo>', maths)


def draw(writer, node, display: str) -> None:
    """Write a formula; with ``sphinx-build -W`` one that fails stops the build."""
    try:
        maths = to_mathml(node.astext(), display)
    except ValueError as err:
        logging.getLogger(__name__).warning("%s", err, location=node)
        maths = writer.encode(node.astext())
    tag = "div" if display == "block" else "span"
    writer.body.append(f'<{tag} class="math">{maths}</{tag}>')
    raise nodes.SkipNode


def setup(app) -> dict:
    """What Sphinx calls."""
    inline = (lambda writer, node: draw(writer, node, "inline"), None)
    block = (lambda writer, node: draw(writer, node, "block"), None)
    app.add_html_math_renderer("mathml", inline, block)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
