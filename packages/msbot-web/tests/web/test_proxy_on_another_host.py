"""A reverse proxy on another computer than the robot: Debian's nginx, by the file of `examples/proxy`."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from tests import ROOT
from tests.certificate import Certificate
from tests.e2e.processes import run
from tests.networks import BODY, DESK, two_computers
from tests.nginx import WHOLE, command, proxy

NAME = "robots.school.example"
EXAMPLE = ROOT / "examples" / "proxy" / "nginx.conf"
PATIENCE_S = 60


def asked(computer: str, *words: str) -> str:
    """What curl on one of the computers is answered, headers included; it waits for a server that is just starting."""
    again = ("--retry", "30", "--retry-delay", "1", "--retry-connrefused", "--max-time", str(PATIENCE_S))
    done = subprocess.run(
        ["ip", "netns", "exec", computer, command("curl"), "-isk", *again, *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_proxy_on_another_computer_says_how_the_page_was_asked_for_and_nobody_else_does(tmp_path: Path) -> None:
    certificate = Certificate(tmp_path)
    with two_computers() as network:
        words = ("--host", BODY, "--trusted-proxy", DESK, "--page-name", NAME, "--link", "udp:127.0.0.1:0")
        assert run("init", cwd=tmp_path).returncode == 0
        robot = network.run(network.body, "master", *words, "--port", "8080", cwd=tmp_path)
        try:
            found = re.search(r"/setup\?token=(\S+)", robot.wait_for("The page is at"))
            assert found is not None
            text = EXAMPLE.read_text().replace("127.0.0.1:8080", f"{BODY}:8080")
            for place, here in (("robots.pem", certificate.certificate), ("robots.key", certificate.key)):
                text = text.replace(f"/etc/ssl/{place}", str(here))
            folder = tmp_path / "nginx"
            folder.mkdir()
            (folder / "nginx.conf").write_text(WHOLE.format(user="user root;", folder=folder, servers=text))
            begin = ["ip", "netns", "exec", network.desk, command("nginx"), "-p", str(folder)]
            with proxy([*begin, "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]):
                form = "&".join((f"token={found[1]}", "name=ada", "password=correct+horse", "again=correct+horse"))
                page = ("--resolve", f"{NAME}:443:127.0.0.1")
                own = ("-H", f"Origin: https://{NAME}", "-d", form)
                answer = asked(network.desk, *page, *own, f"https://{NAME}/rex/setup")
                assert re.match(r"HTTP/\S+ 303", answer), answer
                assert re.search(r"(?im)^location: /rex/\s*$", answer), answer
                cookies = re.findall(r"(?im)^set-cookie: ([^;]+);(.*)$", answer)
                assert cookies
                assert all(re.search(r"(?i)\bsecure\b", kept) for _, kept in cookies), cookies
                whose = "; ".join(pair for pair, _ in cookies)
                me = asked(network.desk, *page, "-H", f"Cookie: {whose}", f"https://{NAME}/rex/api/me")
                assert '"name":"ada"' in me
                # Somebody else in the network says the same of themselves.
                lies = ("-H", "X-Forwarded-Proto: https", "-H", "X-Forwarded-Prefix: /x", "-H", "X-Forwarded-Host: x")
                direct = asked(network.body, *lies, f"http://{BODY}:8080/settings")
                assert re.search(r"(?im)^location: /login", direct), direct
                robot.wait_for(f"--trusted-proxy {BODY}")
        finally:
            robot.end()
