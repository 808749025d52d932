"""The catalogue of words: complete, and with the same values in braces."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import polib
import pytest
from starlette.requests import HTTPConnection

from msbot.config import SAMPLES, differences, load_library, parse_blueprint, wired_parts
from msbot.doctor import Finding
from msbot.doctor.checks.robot_checks import check_robot
from msbot.registry.maintenance.database_maintenance import check_backup
from msbot_agent.text.sentence import counted, said
from msbot_web.html import render
from msbot_web.language import COOKIE, language_of, languages, read_catalogue
from msbot_web.models.robot_models import JournalLine
from msbot_xrce.errors import ConfigError, RegistryError
from tests.doctor.healthy import ROBOT
from tools import catalogue
from tools.catalogue import losses_of_the_links, sentences_of_the_robot, texts_of_the_library, texts_of_the_pages

OTHERS = [language for code, language in languages().items() if code != "en"]
COMPLETE = ["de"]
"""Languages whose texts come with the program's; of another one a new text shows in English until somebody translates
it."""
SHARE = 0.95
"""What a further language has at least."""


def test_each_language_is_known_by_its_own_name() -> None:
    assert [language.name for language in OTHERS] == ["Deutsch", "Fran\u00e7ais"]


@pytest.mark.parametrize("code", [language.code for language in OTHERS if language.code not in COMPLETE])
def test_a_further_language_has_nearly_every_text(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    texts = set().union(*catalogue.everything().values())
    share = 1 - len(texts - set(languages()[code].texts)) / len(texts)
    with capsys.disabled():
        print(f"{code}: {share:.1%} of {len(texts)} texts are translated")
    assert share >= SHARE, f"python tools/catalogue.py shows what {code}.po lacks"


@pytest.mark.parametrize("code", COMPLETE)
def test_every_text_of_the_pages_is_translated(code: str) -> None:
    found = texts_of_the_pages()
    assert "Arrivals" in found, "titles are found at all"
    assert found - set(languages()[code].texts) == set()


@pytest.mark.parametrize("code", COMPLETE)
def test_every_sentence_of_the_robot_is_translated(code: str) -> None:
    found = sentences_of_the_robot()
    assert "heard again after {silence:.1f} s" in found, "the forms are found at all"
    assert found - set(languages()[code].texts) == set()


@pytest.mark.parametrize("code", COMPLETE)
def test_every_reason_for_a_lost_packet_is_translated(code: str) -> None:
    found = losses_of_the_links()
    assert "still waiting when the peer's address ended" in found
    assert found - set(languages()[code].texts) == set()


def test_why_packets_were_lost_is_told_in_german_too() -> None:
    (found,) = check_robot(replace(ROBOT, lost_packets={"still waiting when the peer's address ended": 22}))
    assert isinstance(found, Finding)
    german = languages()["de"].translate(found.saw)
    assert german == "22 Pakete gingen verloren: warteten noch, als die Adresse der Gegenseite endete"


@pytest.mark.parametrize("code", COMPLETE)
def test_the_whole_library_is_translated(code: str) -> None:
    found = texts_of_the_library()
    assert "Servo, 180 degrees" in found
    assert found - set(languages()[code].texts) == set()


def test_a_language_is_one_file_that_translators_tools_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(catalogue, "FOLDER", tmp_path)
    monkeypatch.setattr(catalogue, "MOST_SHOWN", 10_000)
    catalogue.main("--new", "fr")
    made = polib.pofile(str(tmp_path / "fr.po"))
    assert {"Arrivals", "Servo, 180 degrees", "heard again after {silence:.1f} s"} <= {entry.msgid for entry in made}
    (entry,) = (entry for entry in made if entry.msgid == "Arrivals")
    entry.msgstr = "Arriv\u00e9es"
    made.metadata["X-Language-Name"] = "Fran\u00e7ais"
    made.metadata["X-Decimal"] = ","
    made.save()
    french = read_catalogue(tmp_path / "fr.po")
    assert (french.code, french.name, french.number(0.5)) == ("fr", "Fran\u00e7ais", "0,5")
    assert (french.translate("Arrivals"), french.translate("Library")) == ("Arriv\u00e9es", "Library")
    catalogue.main()
    assert "    Library\n" in capsys.readouterr().out, "what is new is shown to the translator"
    assert read_catalogue(tmp_path / "fr.po").texts == {"Arrivals": "Arriv\u00e9es"}, (
        "an update keeps what is translated"
    )


@pytest.mark.parametrize("code", [language.code for language in OTHERS])
def test_translations_have_the_same_values(code: str) -> None:
    for english, text in languages()[code].texts.items():
        # A value may be said twice, or left out where the language needs no more words; none may be made up.
        assert set(re.findall(r"{(\w+)", text)) <= set(re.findall(r"{(\w+)", english)), english


def connection(accept: str = "", chosen: str = "") -> HTTPConnection:
    headers = [(b"accept-language", accept.encode())]
    if chosen:
        headers.append((b"cookie", f"{COOKIE}={chosen}".encode()))
    return HTTPConnection({"type": "http", "headers": headers})


@pytest.mark.parametrize(
    ("accept", "chosen", "code"),
    [
        ("", "", "en"),
        ("de-DE,de;q=0.9", "", "de"),
        ("fr-CA,de;q=0.5", "", "fr"),
        ("it,de;q=0.5", "", "de"),
        ("xx", "", "en"),
        ("de", "en", "en"),
        ("en", "de", "de"),
        ("de", "klingon", "de"),
        (";;,,-", "", "en"),
    ],
)
def test_the_language_follows_choice_then_browser_then_english(accept: str, chosen: str, code: str) -> None:
    assert language_of(connection(accept, chosen)).code == code


def test_what_is_not_translated_shows_in_english() -> None:
    german = languages()["de"]
    assert german.translate("not in the catalogue {n}", n=3) == "not in the catalogue 3"
    assert german.translate("Unplug {name}", name="BB") == "BB ausstecken"


def test_a_sentence_is_said_with_its_values() -> None:
    german = languages()["de"]
    sentence = said(
        "{old} is {state} ({reason})",
        old="AA",
        state=said("lost"),
        reason=said("no beat for {seconds:.1f} s", seconds=5.04),
    )
    assert german.translate(sentence) == "AA ist verloren (kein Herzschlag seit 5,0 s)"
    assert languages()["en"].translate(sentence) == sentence == "AA is lost (no beat for 5.0 s)"


@pytest.mark.parametrize(
    ("number", "words"), [(1, "1 Person kann"), (0, "0 Personen können"), (7, "7 Personen können")]
)
def test_a_number_of_things_has_its_own_form(number: int, words: str) -> None:
    told = counted(number, "{count} person can sign in", "{count} people can sign in")
    assert languages()["de"].translate(told) == f"{words} sich anmelden"


@pytest.mark.parametrize(
    ("value", "form", "words"),
    [(49.9, "", "49,9"), (0.25, ".1f", "0,2"), (1234567.0, ",.1f", "1.234.567,0"), (3, "g", "3")],
)
def test_numbers_are_written_the_german_way(value: float, form: str, words: str) -> None:
    assert languages()["de"].number(value, form) == words
    assert languages()["en"].number(value, form) == format(value, form)


def test_numbers_are_written_and_read_the_french_way() -> None:
    french = languages()["fr"]
    assert french.number(1234567.5, ",.1f") == "1\u202f234\u202f567,5"
    for typed in ("1234,5", "1 234,5", "1\u00a0234,5", "1\u202f234,5", "1234.5"):
        assert french.read_number(typed) == 1234.5
    with pytest.raises(ConfigError, match="is not a number"):
        french.read_number("1 2")


def test_mistakes_in_a_blueprint_and_differences_are_told_in_german_too() -> None:
    german, library = languages()["de"], load_library()
    with pytest.raises(ConfigError) as caught:
        parse_blueprint('[robot]\nname = "R"\nlife = 3\n[[slot]]\nname = "A"\npart = "KY-O37"\n', library)
    assert german.translate(str(caught.value)) == (
        "2 Fehler wurden gefunden:\n"
        '  robot.toml, Zeile 3, robot.life: diesen Schlüssel gibt es hier nicht; bekannt: "manufacturer", "name", '
        '"released", "serial_number", "stop_group", "version"\n'
        '  robot.toml, Zeile 6, slot[0].part: die Bibliothek hat keine Teilenummer "KY-O37"; '
        'meintest du "KY-037" oder "KY-032" oder "KY-023"?'
    )
    before = parse_blueprint(SAMPLES["rover"], library)
    knob, *others = before.slots
    after = replace(before, slots=(replace(knob, part_number="KY-040"), *others))
    told = [german.translate(str(one)) for one in differences(before, after)]
    assert "~ Platz knob, Teil: POT-10K -> KY-040 (ein Teil darin, das nicht mehr passt, wird ausgetragen)" in told, (
        told
    )
    with pytest.raises(ConfigError) as caught:
        parse_blueprint("[robot]\nname = AA\n", library)
    assert german.translate(str(caught.value)).startswith(
        "robot.toml, Zeile 2: Spalte 8: das ist kein Wert; Text braucht Anführungszeichen"
    )


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (
            ("LED a: s=2", "LED b: s=2"),
            "part_2: Pin 2 ist schon von part_1 belegt; verdrahte eines davon anderswo",
        ),
        (
            ("BMP280 a: scl=22, sda=21", "BMP280 b: scl=22, sda=21"),
            "part_2: Adresse 0x76 des I2C an Pin 21 ist schon von part_1 belegt; verdrahte eines davon anderswo",
        ),
        (("HCSR04 eye: echo=5",), 'part_1: die Bibliothek hat keine Teilenummer "HCSR04"; meintest du '),
        (("LED a: s=2, active_low=perhaps",), "part_1: Option active_low muss true oder false sein"),
    ],
)
def test_mistakes_in_the_wiring_of_a_board_are_told_in_german_too(texts: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError) as error:
        wired_parts({f"part_{at}": text for at, text in enumerate(texts, 1)}, load_library())
    assert languages()["de"].translate(str(error.value)).startswith(words)


def test_what_a_process_with_limits_says_of_a_backup_is_told_in_german_too(tmp_path: Path) -> None:
    path = tmp_path / "backup.db"
    path.write_bytes(b"no backup")
    with pytest.raises(RegistryError) as caught:
        check_backup(path, needs_administrator=True)
    said_in_german = languages()["de"].translate(str(caught.value))
    assert said_in_german == "diese Sicherung wird nicht benutzt: sie ist keine Datenbank"


def test_the_name_of_a_part_is_no_word_to_translate() -> None:
    """A part may be called hand, as where a setting comes from is; newcomers have no name yet."""
    lines = [
        (
            JournalLine(number=1, at_ms=0, part=part, slot="", from_state="", to_state="new", reason="", evidence=[]),
            "",
            "",
        )
        for part in ("hand", "newcomer")
    ]
    shown = render("journal", say=languages()["de"].translate, error="", heads=[], lines=lines)
    assert re.findall("<b>(.*?)</b>", shown) == ["hand", languages()["de"].texts["newcomer"]]
