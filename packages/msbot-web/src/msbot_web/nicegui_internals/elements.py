"""Names of elements that NiceGUI has and does not offer."""

from nicegui.elements.mixins.disableable_element import DisableableElement

__all__ = ["DisableableElement"]
