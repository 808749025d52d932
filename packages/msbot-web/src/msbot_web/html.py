"""HTML from templates. Every value is escaped unless its type, `Markup`, says that it is already HTML."""

from __future__ import annotations

from collections.abc import MutableMapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
from jinja2 import BaseLoader, Environment, StrictUndefined, Template, TemplateNotFound
from markupsafe import Markup

from msbot_agent.startup.bytecode_cache import cached_definitions
from msbot_web.root_path import root

__all__ = ["Markup", "render"]


class _KeptTemplates(BaseLoader):
    """Templates of a folder, put into Python once and kept."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def load(self, environment: Environment, name: str, globals: MutableMapping[str, Any] | None = None) -> Template:
        """As the environment asks for it."""
        path = self._folder / name
        ways = (environment.autoescape, environment.trim_blocks, environment.lstrip_blocks)

        def to_python(octets: bytes) -> str:
            return environment.compile(octets.decode(), name, str(path), raw=True, defer_init=True)

        try:
            names = cached_definitions(path, to_python, f"Jinja {jinja2.__version__} {ways}")
        except FileNotFoundError:
            raise TemplateNotFound(name) from None
        return environment.template_class.from_module_dict(environment, names, globals or {})


_templates = Environment(
    loader=_KeptTemplates(Path(str(files("msbot_web") / "templates"))),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    auto_reload=False,
)
_templates.globals["root"] = root


def render(template: str, /, **values: object) -> Markup:
    """The template `templates/TEMPLATE.html` with these values in it.

    Raises:
        jinja2.UndefinedError: the template wants a value that is not given.
    """
    return Markup(_template(template).render(**values))


@cache
def _template(name: str) -> Template:
    return _templates.get_template(f"{name}.html")
