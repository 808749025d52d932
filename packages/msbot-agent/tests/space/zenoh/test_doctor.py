"""What the doctor says of a router that is there, one that is not, and broken certificates."""

from __future__ import annotations

from pathlib import Path

from msbot.doctor.checks.network_checks import check_zenoh
from msbot.doctor.collectors.network_facts import zenoh
from msbot.doctor.finding import Examined
from msbot_agent.space import parse_space
from msbot_agent.space.zenoh import Router
from tests.space.zenoh.sites import HERE, SECURE


def test_the_doctor_tries_each_router(router: Router, certificates: Path) -> None:
    nobody = "tcp/127.0.0.1:7555"
    facts = zenoh(Examined(None, space=parse_space(f"zenoh:{HERE},{nobody}")))
    assert facts.routers == {HERE: "", nobody: "Connection refused"}
    assert [(found.about, found.must) for found in check_zenoh(facts)] == [(nobody, False)]
    alone = zenoh(Examined(None, space=parse_space(f"zenoh:{nobody}")))
    assert [(found.about, found.must) for found in check_zenoh(alone)] == [(nobody, True)]
    (certificates / "broken.pem").write_text("nothing")
    broken = zenoh(Examined(None, space=parse_space(f"zenoh:{SECURE}?ca=broken.pem", folder=certificates)))
    assert "broken.pem" in broken.certificates
