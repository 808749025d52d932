"""What a pupil sees who scans a ticket, over a real HTTP application; in virtual time."""

from __future__ import annotations

import asyncio
import html
import re
from collections.abc import AsyncIterator
from urllib.parse import quote

import httpx
import pytest
from fastapi import FastAPI

from msbot.operations.rights import Role
from msbot_web.access.access_middleware import AccessMiddleware
from msbot_web.access.accounts import Accounts
from msbot_web.access.joining import CODE_S, PICTURES, SIGNS
from msbot_web.access.sign_in_pages import make_forms
from msbot_web.access.sign_in_throttle import FREE_TRIES, SignInRefused
from msbot_web.access.ticket_codes import CLASS_TICKET_S, TicketCodes
from msbot_web.access.users import MemoryUsers
from msbot_web.server import STATIC
from tests.web.access.test_accounts import Clock, PlainHasher, user
from tests.web.access.test_sign_in_pages import COOKIE, COOKIES, HOME

DAY = 86_400.0
NOT_VALID = "this ticket is not valid (any more): ask your teacher for a new one"
USED_UP = "this code is used up or too old: have a new one shown to you"
WRONG = ["", "guess", "..", "YQ.1.x", "\udcff\0\n", "<b>&", "ä" * 300, "x" * 9_000]
"""Words that no ticket has."""


class Office:
    """Accounts and tickets, with two clocks that the test turns."""

    def __init__(self) -> None:
        self.clock, self.wall = Clock(), 1e9
        people = [user("tom", Role.TEACHER), user("Ada <b>", Role.STUDENT)]
        self.accounts = Accounts(MemoryUsers(user("root"), *people), clock=self.clock, hasher=PlainHasher())
        self.passes = TicketCodes(self.accounts, self.clock, lambda: self.wall)

    def class_word(self, places: int) -> str:
        return self.passes.class_tickets.make("tom", "/program", places)[0]


@pytest.fixture
def office() -> Office:
    return Office()


@pytest.fixture
async def pupil(office: Office) -> AsyncIterator[httpx.AsyncClient]:
    """The browser of a pupil."""
    app = FastAPI()
    app.include_router(make_forms(office.accounts, "Robby", COOKIES, office.passes))
    transport = httpx.ASGITransport(
        AccessMiddleware(
            app, office.accounts, ("127.0.0.1",), cookies=COOKIES, owns=lambda *_: False, beat=lambda: b"{}"
        )
    )
    async with httpx.AsyncClient(transport=transport, base_url=HOME) as client:
        yield client


def sentence(answer: httpx.Response) -> str:
    """The one sentence that a page says is wrong."""
    (found,) = re.findall(r'<p (?=[^>]*role="alert")[^>]*class="error"[^>]*>([^<]*)</p>', answer.text)
    return html.unescape(found)


def field(word: str) -> str:
    """A word as a form or an address carries it, also where it is no text."""
    return quote(word, errors="surrogateescape")


async def come_by_another_browser(pupil: httpx.AsyncClient, **fields: str) -> httpx.Response:
    async with httpx.AsyncClient(transport=pupil._transport, base_url=HOME) as other:
        return await other.post("/come", data=fields)


async def post(pupil: httpx.AsyncClient, path: str, **fields: str) -> httpx.Response:
    body = "&".join(f"{name}={field(value)}" for name, value in fields.items())
    return await pupil.post(path, content=body, headers={"content-type": "application/x-www-form-urlencoded"})


async def test_a_ticket_signs_in_by_its_button_only(office: Office, pupil: httpx.AsyncClient) -> None:
    word = office.passes.make("Ada <b>", 7)
    for _ in range(2):  # a camera shows what is behind the link
        page = await pupil.get(f"/pass?word={word}")
        assert page.status_code == 200
        assert "Sign in as Ada &lt;b&gt;" in page.text
        assert "set-cookie" not in page.headers
    foreign = await pupil.post("/pass", data={"word": word}, headers={"origin": "http://evil.example"})
    assert foreign.status_code == 403
    for _ in range(2):  # on any device, as often as wanted
        pupil.cookies.clear()
        done = await pupil.post("/pass", data={"word": word})
        assert (done.status_code, done.headers["location"]) == (303, "/program")
        session = office.accounts.session(pupil.cookies[COOKIE])
        assert session is not None
        assert (session.name, session.role) == ("Ada <b>", Role.STUDENT)


@pytest.mark.parametrize("word", WRONG)
async def test_a_word_of_no_ticket_is_refused_in_one_sentence(
    office: Office, pupil: httpx.AsyncClient, word: str
) -> None:
    for path, name, words in (("/pass", "word", NOT_VALID), ("/come", "ticket", USED_UP)):
        looked = await pupil.get(f"{path}?{name}={field(word)}")
        sent = await post(pupil, path, **{name: word, "name": "Dora"})
        for answer in (looked, sent, await post(pupil, path)):
            assert (answer.status_code, sentence(answer)) == (403, words)
            assert "set-cookie" not in answer.headers
            assert len(answer.text) < 10_000  # what was sent does not come back
    assert office.accounts.role_of("Dora") is None


async def test_a_ticket_whose_time_is_over_says_so_in_the_pupils_language(
    office: Office, pupil: httpx.AsyncClient
) -> None:
    own, of_class = office.passes.make("Ada <b>", 1), office.class_word(30)
    office.wall += DAY
    office.clock.now += CLASS_TICKET_S
    german = {"accept-language": "de"}
    assert sentence(await pupil.get(f"/pass?word={own}", headers=german)).startswith("dieser Zettel gilt nicht (mehr)")
    assert sentence(await pupil.post("/pass", data={"word": own})) == NOT_VALID
    assert sentence(await pupil.get(f"/come?ticket={of_class}")) == USED_UP
    assert sentence(await pupil.post("/come", data={"ticket": of_class, "name": "Dora"})) == USED_UP
    assert office.accounts.role_of("Dora") is None


async def test_whoever_scans_the_ticket_of_the_class_types_a_name(office: Office, pupil: httpx.AsyncClient) -> None:
    word = office.class_word(2)
    assert "tom lets this class in" in (await pupil.get(f"/come?ticket={word}")).text
    for name, words in (("tom", "already"), ("", "name"), (" \t", "name"), ("x" * 65, "64"), ("a\nb", "name")):
        again = await post(pupil, "/come", ticket=word, name=name)
        assert again.status_code == 400
        assert words in sentence(again)
        assert word in again.text  # the form is there again, with its ticket
    assert office.passes.class_tickets.find(word).left == 2, "a name that will not do costs no place"
    waiting = await pupil.post("/come", data={"ticket": word, "name": " Dora "})
    assert (waiting.status_code, office.passes.waiting.names()) == (303, ["Dora"])
    assert office.accounts.role_of("Dora") is None, "nobody has said yes"
    assert "wait a moment" in (await pupil.get(waiting.headers["location"])).text
    asked = waiting.headers["location"].partition("wait=")[2]
    assert sentence(await post(pupil, "/come", wait=asked)) == "you were not let in: ask your teacher"
    await office.passes.let_in("Dora", "tom")
    page = await pupil.get(waiting.headers["location"])
    assert all(PICTURES[number][1] in page.text for number in office.passes.pictures("Dora"))
    assert "set-cookie" not in page.headers, "only its button signs in"
    done = await post(pupil, "/come", wait=asked)
    assert (done.status_code, done.headers["location"]) == (303, "/program")
    session = office.accounts.session(pupil.cookies[COOKIE])
    assert session is not None
    assert (session.name, session.role) == ("Dora", Role.STUDENT)
    pupil.cookies.clear()
    assert (await post(pupil, "/come", wait=asked)).status_code == 403, "once"


async def test_a_class_ticket_lets_no_more_in_than_it_has_places_also_at_once(
    office: Office, pupil: httpx.AsyncClient
) -> None:
    word = office.class_word(3)
    answers = await asyncio.gather(
        *(come_by_another_browser(pupil, ticket=word, name=f"pupil {number}") for number in range(10))
    )
    assert sorted(answer.status_code for answer in answers) == [303] * 3 + [403] * 7
    assert {sentence(answer) for answer in answers if answer.status_code == 403} == {USED_UP}
    assert len(office.passes.waiting.names()) == 3
    office.passes.turn_away(office.passes.waiting.names()[0])
    assert office.passes.class_tickets.find(word).left == 1, "who is turned away takes no place"


async def test_the_same_name_twice_at_once_is_one_pupil(office: Office, pupil: httpx.AsyncClient) -> None:
    word = office.class_word(3)
    answers = await asyncio.gather(*(come_by_another_browser(pupil, ticket=word, name="Dora") for _ in range(3)))
    assert sorted(answer.status_code for answer in answers) == [303, 400, 400]
    assert office.passes.class_tickets.find(word).left == 2


async def test_a_teacher_who_is_none_any_more_lets_nobody_in(office: Office, pupil: httpx.AsyncClient) -> None:
    word = office.class_word(3)
    await office.accounts.change_role("tom", "student", who="root")
    for answer in (await pupil.get(f"/come?ticket={word}"), await post(pupil, "/come", ticket=word, name="Dora")):
        assert (answer.status_code, sentence(answer)) == (403, "tom may not let a class in any more")
    assert office.accounts.role_of("Dora") is None


async def test_guesses_at_tickets_keep_nobody_from_signing_in(office: Office, pupil: httpx.AsyncClient) -> None:
    """A class shares an address: whoever guesses words of 128 random bits has no chance, and locks nobody out."""
    word = office.passes.make("Ada <b>", 1)
    for _ in range(3 * FREE_TRIES):
        assert (await pupil.post("/pass", data={"word": word[:-1]})).status_code == 403
    assert (await pupil.post("/pass", data={"word": word})).status_code == 303
    assert (await pupil.post("/login", data={"name": "tom", "password": "correct horse"})).status_code == 303


async def test_without_an_account_the_class_is_closed(pupil: httpx.AsyncClient) -> None:
    for path in ("/pupils", "/projector", "/pupil?name=Ada"):
        answer = await pupil.get(path)
        assert (answer.status_code, answer.headers["location"]) == (303, f"/login?next={quote(path)}")


@pytest.mark.promise("A pupil leaves neither group, freeze nor take-over, by whatever door")
async def test_nobody_gets_a_second_account_by_the_class_ticket_unseen(
    office: Office, pupil: httpx.AsyncClient
) -> None:
    word = office.class_word(5)
    assert (await post(pupil, "/pass", word=office.passes.make("Ada <b>", 1))).status_code == 303
    for answer in (await pupil.get(f"/come?ticket={word}"), await post(pupil, "/come", ticket=word, name="Eve")):
        assert sentence(answer) == "Ada <b> is signed in here: sign out first"
    other = await come_by_another_browser(pupil, ticket=word, name="Eve")
    assert other.status_code == 303
    assert office.accounts.role_of("Eve") is None
    assert office.passes.waiting.names() == ["Eve"], "the teacher sees the name, and says yes or no"
    office.passes.turn_away("Eve")
    async with httpx.AsyncClient(transport=pupil._transport, base_url=HOME) as browser:
        for answer in (
            await browser.get(other.headers["location"]),
            await post(browser, "/come", wait=other.headers["location"].partition("wait=")[2]),
        ):
            assert sentence(answer) == "you were not let in: ask your teacher"
    assert office.accounts.role_of("Eve") is None


async def test_a_code_of_six_characters_opens_the_list_however_it_is_typed(
    office: Office, pupil: httpx.AsyncClient
) -> None:
    code = office.passes.codes.make("tom", office.class_word(5))
    assert (len(code), set(code) <= set(SIGNS)) == (6, True)
    assert "Code of the class" in (await pupil.get("/come")).text
    for typed in (code, code.lower(), f" {code[:3]}-{code[3:]} "):
        page = await pupil.post("/come", data={"code": typed})
        assert page.status_code == 200
        assert "Ada &lt;b&gt;" in page.text
    newer = office.passes.codes.make("tom", office.class_word(5))
    assert sentence(await pupil.post("/come", data={"code": code})).startswith("there is no such code (any more)")
    office.clock.now += CODE_S
    assert (await pupil.post("/come", data={"code": newer})).status_code == 403
    last = office.passes.codes.make("tom", office.class_word(5))
    await office.accounts.change_role("tom", "student", who="root")
    assert "may not let a class in" in sentence(await pupil.post("/come", data={"code": last}))


@pytest.mark.promise("Codes, pictures and passwords cannot be guessed")
async def test_guesses_at_codes_are_spaced_and_hold_up_no_other_way_in(
    office: Office, pupil: httpx.AsyncClient
) -> None:
    code = office.passes.codes.make("tom", office.class_word(5))
    looked_at = 0
    for second in range(1200):  # as long as a code is valid, ten a second
        office.clock.now += 1.0
        for number in range(10):
            answer = guess(office, f"{second % 10}{number}ZZZZ")
            looked_at += "no such code" in answer
    assert looked_at < 20 + 1200 / 3 + 2, "of 31^6"
    office.passes.codes._total.empty_at = office.clock.now
    assert office.passes.codes.ticket_of(office.passes.codes.make("tom", "word"), "10.0.0.9") == "word"
    assert (await pupil.post("/pass", data={"word": office.passes.make("Ada <b>", 1)})).status_code == 303
    assert code not in office.passes.codes._codes


def guess(office: Office, code: str) -> str:
    """What a wrong code is answered with."""
    try:
        return office.passes.codes.ticket_of(code, "10.0.0.7")
    except SignInRefused as error:
        return str(error)


@pytest.mark.promise("Codes, pictures and passwords cannot be guessed")
async def test_a_pupil_comes_in_by_three_pictures_and_a_guesser_does_not(
    office: Office, pupil: httpx.AsyncClient
) -> None:
    word = office.class_word(5)
    own = office.passes.pictures("Ada <b>")

    async def choose(pictures: tuple[int, ...], pick: str = "Ada <b>") -> httpx.Response:
        chosen = {f"picture{place}": str(number) for place, number in enumerate(pictures)}
        return await post(pupil, "/come", ticket=word, pick=pick, **chosen)

    page = await post(pupil, "/come", ticket=word, pick="Ada <b>")
    assert page.text.count('type="radio"') == 3 * len(PICTURES)
    for file, _ in PICTURES:  # files: many computers have no letters for pictures
        assert page.text.count(f"/web/joining/{file}") == 3
        assert b"<svg" in (STATIC / "joining" / file).read_bytes()
    wrong = tuple((number + 1) % len(PICTURES) for number in own)
    for _ in range(FREE_TRIES):
        assert sentence(await choose(wrong)).startswith("these are not your pictures")
    answer = await choose(own)
    assert (answer.status_code, "retry-after" in answer.headers) == (429, True), "the right ones, too"
    office.clock.now += 60
    assert (await choose(own)).status_code == 303
    session = office.accounts.session(pupil.cookies[COOKIE])
    assert session is not None
    assert session.name == "Ada <b>"
    pupil.cookies.clear()
    word = office.class_word(5)
    assert "Who are you?" in (await choose(own, "tom")).text, "a teacher is in no list"
    await office.accounts.change_password("Ada <b>", "another password", who="root")
    assert office.passes.pictures("Ada <b>") != own
