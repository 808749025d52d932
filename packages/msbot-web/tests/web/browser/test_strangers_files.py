"""Files and texts that strangers bring (worlds, lessons, missions, programs, groups, links): shown as text, never run.

The names of robots, slots, parts and people are planted in `test_hostile_names.py`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import cycle
from pathlib import Path
from urllib.parse import quote

import pytest
from playwright.sync_api import Browser, Dialog, expect

from tests.e2e.processes import running
from tests.web.browser.conftest import Site, call, go, new_page

FORMS = cycle((
    '"><img class=evil src=x onerror=ran(1)>', "'onmouseover='ran(1)' x='", "</script><script class=evil>ran(1)//",
    "{{constructor.constructor('ran(1)')()}}", "javascript:ran(1)//", "<svg class=evil onload=ran(1)>",
    "</style><b class=evil onclick=ran(1)>", "<!--><i class=evil>--><a href=javascript:ran(1)>", "${ran(1)}`-->",
))  # fmt: skip
"""What would run, or make an element, in one place or another: HTML, attributes, scripts, templates, links."""
WOUNDS = """() => {
  const wounds = [...document.querySelectorAll(".evil")].map((one) => one.outerHTML);
  for (const one of document.querySelectorAll("*")) for (const { name, value } of one.attributes) {
    if (/^on/i.test(name)) wounds.push(`${one.localName} ${name}=${value}`);
    const opens = /^(href|src|action|formaction|xlink:href|data)$/i.test(name);
    if (opens && /^[\\s\\0-\\x20]*(javascript|vbscript|data:text)/i.test(value)) wounds.push(`${name}=${value}`);
  }
  return wounds;
}"""
"""Elements and attributes of the page that a text of a stranger has made, or could run."""
SEEN = """() => [document.body.innerText, document.title,
  ...[...document.querySelectorAll("*")].flatMap((one) => [...one.attributes].map((has) => has.value)),
  ...[...document.querySelectorAll("input, textarea")].map((one) => one.value)].join("\\n")"""
"""All that somebody who looks at the page, listens to it or points at things can read."""


class Planted:
    """The texts that were brought, by a word of their own."""

    def __init__(self) -> None:
        self.texts: dict[str, str] = {}

    def __call__(self, word: str) -> str:
        """A hostile text that ends with a word."""
        return self.texts.setdefault(word, f"{next(FORMS)} {word}-text")


plant = Planted()
for name in ("group", "token"):  # names that go into a path: forms without a slash
    plant(name)


def quoted(word: str) -> str:
    """A hostile text as TOML has it."""
    return json.dumps(plant(word))


def world(path: Path) -> None:
    path.write_text(f"""
[world]
name = {quoted("world")}
description = "<b class=evil>nobody sees this</b>"
[[area]]
name = {quoted("area")}
rectangle = [0.5, 0.3, 1.0, 0.6]
[[box]]
name = {quoted("box")}
at = [1.6, 1.2]
size = [0.1, 0.1]
[[robot]]
name = {quoted("place")}
start = [1.0, 0.6]
""")


def lesson(path: Path) -> None:
    path.write_text(f"""+++
title = {quoted("lesson")}
number = 1
robot = "buggy"
hint_after_s = 1
+++

## Aim

<script class=evil>ran(1)</script> <img class=evil src=x onerror=ran(1)> \u202e\u2066 aim-text

[colon](javascript&#58;ran(1)) [plain](javascript:ran(1)) [data](data:text/html,<script>ran(1)</script>)
![elsewhere](http://localhost:1/x.png) ![script](javascript:ran(1)) ["title](x 'a" onmouseover="ran(1)')

## {plant("step")}

| <img class=evil src=x onerror=ran(1)> | cell-text |
|---|---|
| `<svg class=evil onload=ran(1)>` | {plant("cell").replace("|", "")} |

```html
<script class=evil>ran(1)</script> code-text
```

```check
say = {quoted("check")}
when = "stopped"
hint = {quoted("hint")}
```

```question
say = {quoted("question")}
answer = {quoted("choice")}
choices = [{quoted("choice")}, "other"]
```
""")


MISSION = f"""[mission]
title = {quoted("mission")}
story = {quoted("story")}
time_s = 600
hints = [{quoted("mission-hint")}]
explanation = {quoted("explanation")}
[robot]
sample = "buggy"
[[fault]]
kind = "loss"
at = "bumper"
[[do]]
words = {quoted("task")}
operation = "identify"
"""
PROGRAM = f"""from msbot import Part, Switch
part = Part("EVIL-1", describes={plant("describes")!r})
part.publishes("out", Switch)
@part.on_setting("most", float, default=1.0, least=0.0, most=2.0, unit={"<img class=evil src=x onerror=ran(1)>"!r})
def set_most(value):
    pass
print({plant("printed")!r})
part.run()
"""
BLOCKS = {
    "msbot": 1,
    "view": "blocks",
    "workspace": {
        "blocks": {
            "languageVersion": 0,
            "blocks": [
                {
                    "type": "msbot_part",
                    "x": 20,
                    "y": 20,
                    "extraState": {"own": True},
                    "fields": {"PART": "*", "NUMBER": "BLINK-1", "TITLE": plant("block-title")},
                },
                {
                    "type": "msbot_every",
                    "x": 20,
                    "y": 200,
                    "fields": {"SECONDS": 0.5},
                    "inputs": {
                        "DO": {"block": {"type": "variables_set", "fields": {"VAR": {"id": "evil"}}}},
                    },
                },
            ],
        },
        "variables": [{"name": plant("variable"), "id": "evil"}],
    },
}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A buggy in a stranger's world, with a stranger's lessons, and a part that says odd things of itself."""
    folder = tmp_path_factory.mktemp("strangers")
    world(folder / "evil.toml")
    (folder / "lessons").mkdir()
    lesson(folder / "lessons" / "evil.md")
    with ExitStack() as stack:
        where = ("--world", "evil.toml", "--lessons", "lessons", "--port", "0")
        site = Site(stack.enter_context(running("demo", "--robot", "buggy", *where, cwd=folder)))
        yield site


@pytest.mark.promise("Texts and files of strangers are shown as text in the browser, and nothing in them runs")
def test_what_strangers_bring_is_shown_as_text(browser: Browser, site: Site) -> None:
    page = new_page(browser)
    ran: list[str] = []
    errors: list[str] = []
    page.context.expose_function("ran", lambda what: ran.append(str(what)))
    page.on("pageerror", lambda error: errors.append(str(error)))

    def noticed(dialog: Dialog) -> None:
        ran.append(dialog.message)
        dialog.dismiss()

    page.on("dialog", noticed)
    seen: list[str] = []

    def look(path: str, *words: str) -> None:
        """Open a page, and see each text on it."""
        go(page, f"{site.base}{path}")
        look_here(*words)

    def look_here(*words: str) -> None:
        for word in words:
            ending = f"{word}-text"
            page.wait_for_function(f"(word) => ({SEEN})().includes(word)", arg=plant.texts.get(word, ending))
        seen.extend(words)
        assert page.evaluate(WOUNDS) == []

    go(page, site.link)
    for method, path, body in plants():
        assert call(page, method, path, body) == 200, path
    look("/arena", "world", "place", "area", "box")
    look("/learn")
    page.get_by_text(plant("lesson")).first.click()
    look_here("lesson", "step", "cell", "check", "question", "aim", "code")
    expect(page.get_by_text(plant("hint"))).to_be_visible()
    for text in ("colon", "plain", "data"):  # a press leads nowhere
        found = page.get_by_text(text, exact=True)
        if found.count():
            found.first.click(force=True)
    assert call(page, "POST", "/api/lesson/stop", {}) == 200
    assert call(page, "POST", "/api/mission/start", {"mission": "mine", "toml": MISSION, "seed": 1}) == 200
    assert call(page, "POST", "/api/mission/hint", {}) == 200
    look("/missions", "mission", "story", "mission-hint", "task")
    assert call(page, "POST", "/api/mission/stop", {}) == 200
    look("/missions", "explanation")
    look("/pupils", "group", "frozen")
    look("/projector", "group")
    look("/admin", "token")
    look("/journal?part=" + quote(plant("asked-journal")))
    assert call(page, "POST", "/api/stop", {"reason": plant("stopped")}) == 200
    look("/", "stopped")
    for path in ("/bus?find=", "/plots?show=", "/pupil?name=", "/?slot=", "/library/", "/handbook/", "/program?name="):
        page.goto(site.base + path + quote(f"{plant('asked')}", safe=""))
        assert page.evaluate(WOUNDS) == []
    look("/program?name=evil.py")
    expect(page.locator(".cm-content")).to_contain_text("describes")
    page.get_by_role("button", name="Run", exact=True).click()
    look_here("printed")
    other = page.context.new_page()
    go(other, f"{site.base}/arrivals")  # where the part is that the program makes
    expect(other.get_by_text(plant("describes")).first).to_be_attached()
    assert other.evaluate(WOUNDS) == []
    other.close()
    look("/program?name=blocks.py")
    # The picture of a block cuts a long text off; who listens to it gets all of it.
    expect(page.get_by_role("button", name=re.compile("block-title-text")).first).to_be_attached()
    look_here("block-title", "variable")
    assert ran == []
    assert errors == []
    unseen = set(plant.texts) - {*seen, "asked", "asked-journal", "describes", "choice", "hint"}
    assert not unseen
    page.context.close()


def plants() -> Iterator[tuple[str, str, object]]:
    """What is brought through the API."""
    yield "POST", "/api/users", {"name": "pupil", "role": "student", "password": "long enough"}
    yield "PUT", f"/api/class/groups/{quote(plant('group'), safe='')}", {"pupils": ["pupil"], "slots": ["bumper"]}
    yield "POST", "/api/users/pupil/tokens", {"words": plant("token")}
    yield "PUT", "/api/programs/evil.py", {"text": PROGRAM}
    yield "PUT", "/api/programs/blocks.py", {"text": "print(1)\n", "blocks": json.dumps(BLOCKS)}
    yield "POST", "/api/class/freeze", {"reason": plant("frozen")}
    yield "POST", "/api/lesson/start", {"lesson": "evil"}
