"""The pages: one file each; they are thin, because `Service` provides what they show and do."""

from __future__ import annotations

from msbot_web.pages import (
    admin,
    api_docs,
    arena,
    bus,
    classroom,
    doctor,
    extension_pages,
    faults,
    gallery,
    hand_ins,
    handbook_pages,
    journal,
    learn,
    library,
    missions,
    plots,
    program,
    projector,
    pupil_program,
    pupils,
    quiz,
    robot,
    settings,
    timeline,
    waiting_parts,
    wires,
)
from msbot_web.service import Service


def register_pages(service: Service) -> None:
    """Make the pages of one robot known to NiceGUI; to be called once in a process."""
    for page in (
        robot,
        waiting_parts,
        settings,
        bus,
        wires,
        program,
        arena,
        gallery,
        plots,
        timeline,
        learn,
        hand_ins,
        quiz,
        library,
        journal,
        missions,
        faults,
        doctor,
        classroom,
        pupils,
        pupil_program,
        projector,
        admin,
        api_docs,
        handbook_pages,
        extension_pages,
    ):
        page.register(service)


__all__ = ["register_pages"]
