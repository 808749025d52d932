"""All that depends on what NiceGUI and its server have inside, in one place: nobody promises that it stays.

Elsewhere only `nicegui.ui`, `nicegui.Client` and `nicegui.events` are used. `tests.web.test_nicegui_internals` fails
when a new version has moved something that is used here, or when something outside uses more.

| file | uses | for |
|---|---|---|
| `application` | `core.app`, `core.sio`, the templates, the redirecting middleware | pages in our own application |
| `startup` | the garbage collector, the turns of threads, the import system | a start in half the time, undisturbed |
| `page_sockets` | the handlers and sockets of engine.io | bounds for what a page may send |
| `page_admission` | `Client.instances` | how many pages are made at a time, and for whom |
| `open_pages` | the handlers of socket.io, `Client.instances` | what a page may do belongs to whom it was made for |
| `outboxes` | how `Outbox.loop` waits | pages with nothing to say sleep |
| `late_websocket` | uvicorn's choice of a protocol | the protocol of websockets is loaded when needed |
| `elements` | mixins and constants of elements | names that NiceGUI does not offer |
"""
