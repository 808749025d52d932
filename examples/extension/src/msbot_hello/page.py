"""A page that greets the robot, and a call of the API that does."""

from fastapi import APIRouter
from nicegui import ui

from msbot_web import ExtensionPage, Page, Service


def show(page: Page) -> None:
    words = ui.label().classes("panel")
    page.every_look(lambda: words.set_text(f"Hello, {page.service.robot_name}: {len(page.sight.robot().slots)} slots"))


def routes(service: Service) -> APIRouter:
    router = APIRouter()

    @router.get("/greeting")
    async def greeting() -> str:
        """A greeting."""
        return f"Hello, {service.robot_name}!"

    return router


PAGE = ExtensionPage("Hello", show, icon="waving_hand")
