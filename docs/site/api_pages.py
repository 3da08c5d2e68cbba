"""The API reference: a page for each public module, from the source alone; nothing is imported."""

import ast
import re
import textwrap
from functools import cached_property
from pathlib import Path

from docstrings import Link, first_line, markdown

LONGEST_CONSTANT = 12  # lines; what is longer is to be read in the source
Definition = ast.FunctionDef | ast.ClassDef


class Module:
    """A source file, parsed."""

    def __init__(self, name: str, path: Path):
        self.name, self.is_package = name, path.name == "__init__.py"
        self.text = path.read_text(encoding="utf-8")
        self.tree = ast.parse(self.text)
        self.doc = ast.get_docstring(self.tree) or ""

    @property
    def definitions(self) -> list[Definition]:
        """Public functions and classes, in the order of the file."""
        return _public(self.tree.body)

    @cached_property
    def imported(self) -> dict[str, str]:
        """What a name that was imported is called in full."""
        froms = (node for node in ast.walk(self.tree) if isinstance(node, ast.ImportFrom))
        return {a.asname or a.name: f"{node.module}.{a.name}" for node in froms for a in node.names}

    def lines(self, first: ast.stmt, last: ast.stmt) -> str:
        """Source from one statement to another, with the comments beside them."""
        return textwrap.dedent(
            "\n".join(self.text.splitlines()[first.lineno - 1 : last.end_lineno])
        )


def public_modules(package: Path) -> dict[str, Module]:
    """All modules whose name does not begin with an underscore, by full name."""
    found = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        parts = parts[:-1] if parts[-1] == "__init__" else parts
        if not any(part.startswith("_") for part in parts):
            found[".".join(parts)] = Module(".".join(parts), path)
    return found


def full_names(modules: dict[str, Module]) -> set[str]:
    """Everything that has a place in the reference."""
    names = set(modules)
    for module in modules.values():
        for one in module.definitions:
            names.add(f"{module.name}.{one.name}")
            if isinstance(one, ast.ClassDef):
                names |= {f"{module.name}.{one.name}.{method.name}" for method in _public(one.body)}
    return names


def api_pages(
    modules: dict[str, Module], order: list[str], lessons: dict[str, str]
) -> dict[str, str]:
    """Markdown by name of page.

    ``order``: packages and modules of the first level; ``lessons``: files by their two digits.
    """

    def to_lesson(match: re.Match) -> str:
        return f"[{match[0]}](../{lessons[match[1]]})" if match[1] in lessons else match[0]

    names = full_names(modules)
    pages = {}
    for module in modules.values():
        below = [m for m in modules.values() if m.name.rpartition(".")[0] == module.name]
        if module.name == "dancediff":
            rank = {name: k for k, name in enumerate(order)}
            below.sort(key=lambda m: (rank.get(m.name.split(".")[1], len(rank)), m.name))
        page = _page(module, below, modules, names)
        pages[f"api/{module.name}"] = re.sub(r"\bnotebook (\d\d)\b", to_lesson, page)
    return pages


def _page(module: Module, below: list[Module], modules: dict[str, Module], names: set[str]) -> str:
    """One module: what it says of itself, what is below it, then all that it defines."""
    link = _linker(module, names)
    short = module.name.removeprefix("dancediff.")
    parts = [
        f"# {'API' if module.name == 'dancediff' else short}",
        f"```{{py:module}} {module.name}\n```",
        markdown(module.doc, link),
    ]
    if module.is_package:
        parts.append(_offered(module, modules, names))
    if below:
        rows = [
            f"| [{m.name.rpartition('.')[2]}]({m.name}.md) | "
            + first_line(m.doc, _linker(m, names)).replace("|", r"\|")
            + " |"
            for m in below
        ]
        parts.append("\n".join(["| module | |", "| --- | --- |", *rows]))
        entries = [f"{m.name.rpartition('.')[2]} <{m.name}>" for m in below]
        parts.append("\n".join(["```{toctree}", ":hidden:", "", *entries, "```"]))
    if constants := _constants(module):
        parts.append(f"```python\n{constants}\n```")
    parts += [_definition(module, one, link) for one in module.definitions]
    return "\n\n".join(part for part in parts if part) + "\n"


def _offered(module: Module, modules: dict[str, Module], names: set[str]) -> str:
    """What may be imported from a package, but lives further down."""
    assigned = {
        ast.unparse(node.targets[0]): node.value
        for node in module.tree.body
        if isinstance(node, ast.Assign)
    }
    if "_HOME" in assigned:  # of `dancediff` itself, which imports nothing until it is used
        homes = ast.literal_eval(assigned["_HOME"])
        offered = {k: modules[v].imported.get(k, f"{v}.{k}") for k, v in homes.items()}
    elif "__all__" in assigned:
        offered = {k: module.imported.get(k, "") for k in ast.literal_eval(assigned["__all__"])}
    else:
        return ""
    links = [
        f"{{py:obj}}`{name} <{full}>`" if full in names else f"`{name}`"
        for name, full in offered.items()
    ]
    return f"Offered here: {' · '.join(links)}"


def _constants(module: Module) -> str:
    """Public values at the top level, as they are written."""
    chosen = [
        node
        for node in module.tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        and re.match(r"[A-Za-z]\w*(: .+)? = ", ast.unparse(node))
        and node.end_lineno - node.lineno < LONGEST_CONSTANT
    ]
    return "\n".join(module.lines(node, node) for node in chosen)


def _definition(module: Module, node: Definition, link: Link, *, inside: str = "") -> str:
    """A Sphinx directive for a function, class, method or property."""
    decorators = {ast.unparse(d) for d in node.decorator_list}
    options: list[str] = []
    body = [markdown(ast.get_docstring(node) or "", link)]
    if isinstance(node, ast.ClassDef):
        kind, head = "class", f"{node.name}{_made_with(node)}"
        if fields := _fields(module, node):
            body.append(f"```python\n{fields}\n```")
        body += [_definition(module, m, link, inside=node.name) for m in _public(node.body)]
    elif decorators & {"property", "cached_property"}:
        kind, head = "property", f"{inside}.{node.name}"
        options += [f":type: {_bare(node.returns)}"] if node.returns else []
    else:
        kind = "method" if inside else "function"
        head = f"{inside}.{node.name}" if inside else node.name
        head += _signature(node, bound=bool(inside) and "staticmethod" not in decorators)
        options += [f":{name}:" for name in ("classmethod", "staticmethod") if name in decorators]
    fence = ":" * (5 if inside else 6)
    lines = [f"{fence}{{py:{kind}}} {head}", f":module: {module.name}", *options, ""]
    return "\n".join([*lines, "\n\n".join(part for part in body if part), fence])


def _made_with(node: ast.ClassDef) -> str:
    """The arguments of a class that has an ``__init__`` of its own."""
    for one in node.body:
        if isinstance(one, ast.FunctionDef) and one.name == "__init__":
            return _signature(one, bound=True)
    return ""


def _signature(node: ast.FunctionDef, *, bound: bool) -> str:
    arguments = node.args
    if bound and (arguments.posonlyargs or arguments.args):
        (arguments.posonlyargs or arguments.args).pop(0)
    returns = f" -> {_bare(node.returns)}" if node.returns and node.name != "__init__" else ""
    return f"({ast.unparse(arguments)}){returns}"


def _bare(annotation: ast.expr) -> str:
    """A type without the quotes that only Python needs."""
    return ast.unparse(annotation).strip("'\"")


def _fields(module: Module, node: ast.ClassDef) -> str:
    """The fields of a dataclass as written: the comments beside them say what they are."""
    upto = next((k for k, n in enumerate(node.body) if isinstance(n, ast.FunctionDef)), None)
    fields = [n for n in node.body[:upto] if isinstance(n, ast.AnnAssign)]
    return module.lines(fields[0], node.body[:upto][-1]) if fields else ""


def _public(body: list[ast.stmt]) -> list[Definition]:
    return [
        node
        for node in body
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        and not node.name.startswith("_")
        and ast.get_docstring(node)
        and not any(ast.unparse(d).endswith(".setter") for d in node.decorator_list)
    ]


def _linker(module: Module, names: set[str]) -> Link:
    """Looks a name up as Python would: here, then among what is imported, then as it stands."""

    def link(name: str) -> str | None:
        first, _, rest = name.partition(".")
        there = ".".join(filter(None, (module.imported.get(first, first), rest)))
        beside = f"{module.name.rpartition('.')[0]}.{name}"
        return next((n for n in (f"{module.name}.{name}", there, beside) if n in names), None)

    return link
