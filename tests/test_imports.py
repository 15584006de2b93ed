"""The one direction of imports (DESIGN §1), checked in every file's syntax tree."""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
OURS = ("attn_tree", "baselines", "envs", "runs", "tests")

# prefix of a module -> prefixes of ours that it may import; the longest prefix that fits counts.
ALLOWED = {
    "attn_tree": ("attn_tree",),
    "attn_tree.vision": ("attn_tree.vision",),
    "attn_tree.tree": ("attn_tree.tree",),
    "baselines": (
        "baselines",
        "attn_tree.vision",
        "attn_tree.tree",
        # Controls that are trees or tables use the one learner, with questions of their own.
        "attn_tree.q_learning",
        "attn_tree.table_policy",
        "attn_tree.rates",
        "attn_tree.learner",
        "attn_tree.tree_learner",
        "attn_tree.vocabulary",
        "attn_tree.growth",
        "attn_tree.percepts",
        "attn_tree.rlvc",
        "attn_tree.history",
        "attn_tree.joint",
    ),
    "envs": ("envs",),
    "runs": ("runs", "envs", "baselines", "attn_tree"),
}


def _module(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def _imports(path: Path) -> set[str]:
    module = _module(path)
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*parts, base]) if base else ".".join(parts)
            found.add(base)
            found.update(f"{base}.{alias.name}" for alias in node.names)
    return {name for name in found if name.split(".")[0] in OURS}


def _fits(name: str, prefix: str) -> bool:
    return name == prefix or name.startswith(prefix + ".")


def test_imports_follow_the_arrows() -> None:
    broken = []
    for path in sorted(p for package in ALLOWED for p in (ROOT / package.replace(".", "/")).rglob("*.py")):
        module = _module(path)
        allowed = ALLOWED[max((p for p in ALLOWED if _fits(module, p)), key=len)]
        for name in _imports(path):
            # `import a.b` also names the package a: what is above an allowed prefix passes too.
            if not any(_fits(name, prefix) or _fits(prefix, name) for prefix in allowed):
                broken.append(f"{module} imports {name}")
    assert not broken, "\n".join(broken)


def test_imports_have_no_cycles() -> None:
    files = {
        _module(p): p
        for package in OURS[:4]
        for p in (ROOT / package).rglob("*.py")
        if "benchmarks" not in p.parts
    }
    graph = {
        name: {n for n in _runtime_imports(path) if n in files and n != name} for name, path in files.items()
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " -> ".join([*trail[trail.index(name) :], name])
        if name not in done:
            for target in graph[name]:
                # A package's __init__ gathers its modules; a module inside it does not depend on it.
                if not _fits(name, target):
                    visit(target, (*trail, name))
            done.add(name)

    for name in graph:
        visit(name, ())


def _runtime_imports(path: Path) -> set[str]:
    """Imports at module level, outside `if TYPE_CHECKING`."""
    tree = ast.parse(path.read_text())
    tree.body = [node for node in tree.body if isinstance(node, (ast.Import, ast.ImportFrom))]
    source = ast.unparse(tree)
    scratch = {alias for alias in _imports(path)}
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names.add(node.module or "")
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            names.update(n for n in scratch if n.endswith(tuple(f".{a.name}" for a in node.names)))
            names.update(n for n in scratch if node.module and n.endswith(f".{node.module}"))
    return names
