"""HTML from templates. Every value is escaped unless its type, `Markup`, says that it is already HTML."""

from __future__ import annotations

from functools import cache
from importlib.resources import files

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

__all__ = ["Markup", "render"]

_templates = Environment(
    loader=FileSystemLoader(str(files("msbot.web") / "templates")),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    auto_reload=False,
)


def render(template: str, /, **values: object) -> Markup:
    """The template `templates/TEMPLATE.html` with these values in it.

    Raises:
        jinja2.UndefinedError: the template wants a value that is not given.
    """
    return Markup(_template(template).render(**values))


@cache
def _template(name: str) -> Template:
    return _templates.get_template(f"{name}.html")
