"""The world of Jacdac: modules of MakeCode and others, by USB through a browser, or through Jacdac's own tools."""
