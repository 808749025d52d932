"use strict"
// The modules that this browser reaches, and their frames to and from the bridge that has served this page.

const GERMAN = {
    "Modules that this page reaches become parts of the robot. Keep this tab open.":
        "Module, die diese Seite erreicht, werden Teile des Roboters. Lass diesen Tab offen.",
    "Connecting to the bridge...": "Die Bridge wird gesucht...",
    "Connected to the bridge": "Mit der Bridge verbunden",
    "The bridge is not running. This page tries again.": "Die Bridge läuft nicht. Diese Seite versucht es weiter.",
    "Connect modules by USB": "Module über USB verbinden",
    "Simulate a module:": "Ein Modul simulieren:",
    "Add": "Hinzufügen",
    "Modules": "Module",
    "None yet.": "Noch keine.",
    "This browser cannot use USB. Take Chrome, Edge or Opera.":
        "Dieser Browser kann kein USB. Nimm Chrome, Edge oder Opera.",
}
const german = (navigator.language || "").startsWith("de")
const say = text => (german && GERMAN[text]) || text
const at = id => document.getElementById(id)
document.documentElement.lang = german ? "de" : "en"
for (const [id, text] of [
    ["about", "Modules that this page reaches become parts of the robot. Keep this tab open."],
    ["bridge", "Connecting to the bridge..."],
    ["usb", "Connect modules by USB"],
    ["simulate", "Simulate a module:"],
    ["add", "Add"],
    ["heading", "Modules"],
])
    at(id).textContent = say(text)

class Bridge extends jacdac.JDBridge {
    constructor() {
        super("msbot", true)
        this.open()
    }
    open() {
        const socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/[^/]*$/, "frames"))
        socket.binaryType = "arraybuffer"
        socket.onopen = () => (at("bridge").textContent = say("Connected to the bridge"))
        socket.onmessage = event => this.receiveFrameOrPacket(new Uint8Array(event.data))
        socket.onclose = () => {
            at("bridge").textContent = say("The bridge is not running. This page tries again.")
            setTimeout(() => this.open(), 1000)
        }
        this.socket = socket
    }
    sendPacket(frame) {
        if (this.socket.readyState === WebSocket.OPEN) this.socket.send(frame)
    }
}

const canUsb = jacdac.isWebUSBSupported()
const bus = new jacdac.JDBus(canUsb ? [jacdac.createUSBTransport()] : [], { client: false, disableRoleManager: true })
new Bridge().bus = bus
window.bus = bus // for the browser's console

at("usb").disabled = !canUsb
if (!canUsb) at("trouble").textContent = say("This browser cannot use USB. Take Chrome, Edge or Opera.")
at("usb").onclick = async () => {
    at("trouble").textContent = ""
    try {
        await bus.connect()
    } catch (error) {
        at("trouble").textContent = String(error.message || error)
    }
}

const kinds = jacdac.serviceProviderDefinitions().sort((a, b) => a.name.localeCompare(b.name))
for (const kind of kinds) at("kinds").append(new Option(kind.name, kind.name))
at("kinds").value = "servo"
at("add").onclick = () => jacdac.addServiceProvider(bus, kinds.find(kind => kind.name === at("kinds").value))

function show() {
    const items = bus.devices({ ignoreInfrastructure: true }).map(device => {
        const item = document.createElement("li")
        const services = device.services().slice(1).map(service => service.name)
        item.textContent = `${device.shortId}: ${services.join(", ") || "?"}`
        return item
    })
    if (!items.length) {
        const none = document.createElement("li")
        none.textContent = say("None yet.")
        items.push(none)
    }
    at("modules").replaceChildren(...items)
}
bus.on(jacdac.DEVICE_CHANGE, show)
bus.start()
show()
