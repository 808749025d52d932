"""Signing in by the plain forms, over a real HTTP application."""

from __future__ import annotations

from collections.abc import AsyncIterator

import httpx
import pytest
from fastapi import FastAPI

from msbot.operations.rights import Role
from msbot_web.access.access_middleware import AccessMiddleware, cookie_names
from msbot_web.access.accounts import Accounts
from msbot_web.access.sign_in_pages import local_path, make_forms
from msbot_web.access.sign_in_throttle import FREE_TRIES
from msbot_web.access.users import MemoryUsers
from tests.web.access.test_accounts import Clock, PlainHasher

COOKIES = cookie_names("12345678")
COOKIE = COOKIES.session
HOME = "http://127.0.0.1:8080"


@pytest.fixture
def accounts() -> Accounts:
    return Accounts(MemoryUsers(), clock=Clock(), hasher=PlainHasher())


@pytest.fixture
def is_open() -> bool:
    """Whether the first visitor needs no link."""
    return False


@pytest.fixture
async def browser(accounts: Accounts, is_open: bool) -> AsyncIterator[httpx.AsyncClient]:
    app = FastAPI()
    app.include_router(make_forms(accounts, "Robby <b>", COOKIES, is_open=is_open))
    transport = httpx.ASGITransport(
        AccessMiddleware(app, accounts, ("127.0.0.1",), cookies=COOKIES, owns=lambda *_: False, beat=lambda: b"{}")
    )
    async with httpx.AsyncClient(transport=transport, base_url=HOME) as client:
        yield client


async def test_the_set_up_link_leads_to_an_administrator(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    token = accounts.setup_token()
    page = await browser.get(f"/setup?token={token}")
    assert page.status_code == 200
    assert token in page.text
    form = {"token": token, "name": "ada", "password": "correct horse", "again": "correct hose"}
    wrong = await browser.post("/setup", data=form)
    assert wrong.status_code == 400
    assert "not the same" in wrong.text
    assert 'value="ada"' in wrong.text  # only what was wrong is typed again
    done = await browser.post("/setup", data={**form, "again": "correct horse"})
    assert (done.status_code, done.headers["location"]) == (303, "/")
    assert accounts.session(browser.cookies[COOKIE]) is not None
    again = await browser.post("/setup", data={**form, "again": "correct horse"})
    assert again.status_code == 403


@pytest.mark.parametrize("is_open", [True])
async def test_a_page_with_an_open_set_up_makes_the_first_visitor_administrator_and_no_other(
    accounts: Accounts, browser: httpx.AsyncClient
) -> None:
    token = accounts.setup_token()
    assert token in (await browser.get("/login")).text
    form = {"token": token, "name": "ada", "password": "correct horse", "again": "correct horse"}
    assert (await browser.post("/setup", data=form)).status_code == 303
    browser.cookies.clear()
    second = (await browser.get("/login")).text
    assert 'name="token"' not in second
    assert 'name="password"' in second
    assert (await browser.post("/setup", data={**form, "name": "eve"})).status_code == 403


async def test_until_somebody_is_set_up_the_sign_in_says_where_the_link_is(browser: httpx.AsyncClient) -> None:
    assert "set-up link" in (await browser.get("/login")).text


async def test_a_card_whose_set_up_file_is_wrong_says_where_the_mistake_is_told(accounts: Accounts) -> None:
    app = FastAPI()
    app.include_router(make_forms(accounts, "Robby", COOKIES, is_on_card=lambda: True))
    async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=HOME) as client:
        said = (await client.get("/login")).text
        form = {"token": "", "name": "eve", "password": "correct horse", "again": "correct horse"}
        assert (await client.post("/setup", data=form)).status_code == 403
    assert "msbot-setup-mistakes.txt" in said
    assert "terminal" not in said  # it has none
    assert accounts.setup_token() not in said


async def test_signing_in_and_out(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    await accounts.set_up(accounts.setup_token(), "ada", "correct horse")
    assert 'name="password"' in (await browser.get("/login")).text
    form = {"name": "ada", "password": "correct horse", "next": "/bus"}
    done = await browser.post("/login", data=form)
    assert (done.status_code, done.headers["location"]) == (303, "/bus")
    cookie = done.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=lax" in cookie
    session = accounts.session(browser.cookies[COOKIE])
    assert session is not None
    assert session.name == "ada"
    out = await browser.post("/logout")
    assert (out.status_code, out.headers["location"]) == (303, "/login")
    assert accounts.session(session.token) is None


async def test_a_removed_pupil_reads_why(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    await accounts.set_up(accounts.setup_token(), "ada", "correct horse")
    await accounts.add_user("bob <i>", Role.STUDENT, "correct horse", who="ada")
    await browser.post("/login", data={"name": "bob <i>", "password": "correct horse"})
    await accounts.remove_user("bob <i>", who="ada")
    gone = await browser.get("/program")
    assert (gone.status_code, gone.headers["location"]) == (303, "/login?next=/program")
    words = "the account bob &lt;i&gt; was removed: ask your teacher if that is a mistake"
    assert words in (await browser.get("/login?next=/program")).text
    assert "Das Konto bob" in (await browser.get("/login", headers={"accept-language": "de"})).text
    await browser.post("/login", data={"name": "ada", "password": "correct horse"})
    assert words not in (await browser.get("/login")).text
    browser.cookies.clear()
    assert words not in (await browser.get("/login")).text


async def test_wrong_passwords_lock_for_a_while(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    await accounts.set_up(accounts.setup_token(), "ada", "correct horse")
    for _ in range(FREE_TRIES):
        wrong = await browser.post("/login", data={"name": "ada", "password": "guess"})
        assert wrong.status_code == 401
        assert "wrong name or password" in wrong.text
    locked = await browser.post("/login", data={"name": "ada", "password": "correct horse"})
    assert locked.status_code == 429
    assert int(locked.headers["retry-after"]) == 30


async def test_the_entry_link_of_the_demo(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    token = accounts.entry_token()
    assert (await browser.get("/enter?token=x")).status_code == 403
    done = await browser.get(f"/enter?token={token}&next=/bus")
    assert (done.status_code, done.headers["location"]) == (303, "/bus")


async def test_names_are_shown_as_text(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    token = '"><script>alert(1)</script>'
    page = (await browser.get("/setup", params={"token": token})).text
    assert "<script>" not in page
    assert "Robby &lt;b&gt;" in page
    await accounts.set_up(accounts.setup_token(), "ada", "correct horse")
    assert "<script>" not in (await browser.get("/login", params={"next": token})).text


async def test_an_overlong_or_broken_form_is_a_wrong_one(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    await accounts.set_up(accounts.setup_token(), "ada", "correct horse")
    assert (await browser.post("/login", content=b"name=ada&password=" + b"x" * 20_000)).status_code == 401
    assert (await browser.post("/login", content=b"\xff\xfe%%%&&==")).status_code == 401
    assert (await browser.post("/login", content=b"&".join(b"a=1" for _ in range(100)))).status_code == 401


@pytest.mark.parametrize(
    "wanted", ["//evil.example", "/\\evil.example", "https://evil.example", "javascript:alert(1)", "", "/a\nb", "\\\\x"]
)
def test_nobody_is_sent_to_another_site(wanted: str) -> None:
    assert local_path(wanted) == "/"


def test_a_page_of_ones_own_is_where_one_goes() -> None:
    assert local_path("/library/SG90?x=1") == "/library/SG90?x=1"


async def test_the_form_speaks_the_browsers_language(accounts: Accounts, browser: httpx.AsyncClient) -> None:
    await accounts.set_up(accounts.setup_token(), "ada", "correct horse")
    page = (await browser.get("/login", headers={"accept-language": "de-NZ,de;q=0.9,en;q=0.5"})).text
    assert "Anmelden" in page
    assert '<html lang="de">' in page
