"""A Wireshark dissector of DDS-XRCE in Lua, generated from `layout`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from msbot_xrce.layout import (
    BODIES,
    FLAGS,
    HEADER,
    HEADER_KEY,
    SUBMESSAGE,
    SUBMESSAGE_WORDS,
    Envelope,
    Form,
    LaidField,
)
from msbot_xrce.messages.ids import SESSION_NONE, ObjectKind, SubmessageId
from msbot_xrce.messages.submessage import LITTLE_ENDIAN

PORT = 8888
"""The usual UDP port of an agent."""


def dissector(ports: Iterable[int] = (PORT,), envelope: Envelope | None = None) -> str:
    """The Lua file.

    Args:
        ports: UDP ports whose packets are DDS-XRCE without being asked.
        envelope: what may be beside it on these ports.
    """
    fields = _all_fields()
    envelope_fields = {} if envelope is None else _envelope_fields(envelope)
    bodies = "\n".join(f"  [{int(kind)}] = {_row(body)}," for kind, body in BODIES.items())
    flags = "\n".join(f'  {{"{name}", {bit}, {"nil" if of is None else int(of)}}},' for name, bit, of in FLAGS)
    declared = "\n".join(f"f.{name} = {_proto_field(field)}" for name, field in fields.items())
    flag_fields = "\n".join(
        f'f.flag_{name} = ProtoField.bool("xrce.flag.{name}", "{name}", 8, nil, {bit})' for name, bit, _ in FLAGS
    )
    declared += "".join(f"\nf.{name} = {_proto_field(field)}" for name, field in envelope_fields.items())
    to_the_end = ", ".join(f"[{int(kind)}] = true" for kind in (SubmessageId.WRITE_DATA, SubmessageId.DATA))
    registered = "\n".join(f"ports:add({port}, xrce)" for port in ports)
    return f"""\
-- DDS-XRCE 1.0 for Wireshark. Written by `msbot explain --wireshark`; do not edit.
-- Use it: put it into the folder of personal Lua plugins (Help, About Wireshark, Folders), or
--   tshark -X lua_script:msbot_xrce.lua -r capture.pcap -O xrce
-- Other ports than these: Analyze, Decode As.
local xrce = Proto("xrce", "DDS-XRCE")
local f = xrce.fields
{declared}
{flag_fields}
f.service = ProtoField.string("xrce.service", "service")

local cut = ProtoExpert.new("xrce.cut", "the submessage is longer than the packet", expert.group.MALFORMED,
                            expert.severity.ERROR)
xrce.experts = {{ cut }}

local names = {_lua_words(SUBMESSAGE_WORDS)}
local header = {_row(HEADER)}
local header_key = {_row((HEADER_KEY,))}
local submessage = {_row(SUBMESSAGE)}
local flags = {{
{flags}
}}
local bodies = {{
{bodies}
}}
local to_the_end = {{ {to_the_end} }}

-- Adds the fields of a row; returns where the next one begins.
local function add(tree, row, tvb, at, last, little)
  for _, one in ipairs(row) do
    local name, size, form = one[1], one[2], one[3]
    if at >= last then return at end
    if form == "text" then size = 1 + tvb(at, 1):uint() end
    if size == 0 then size = last - at end
    if at + size > last then return at end
    local octets = tvb(at, size)
    if form == "text" then
      tree:add(f[name], octets, size > 1 and tvb(at + 1, size - 1):string(ENC_UTF_8) or "")
    elseif form == "little" or (form == "number" and little) then
      tree:add_le(f[name], octets)
    else
      tree:add(f[name], octets)
    end
    at = at + size
  end
  return at
end

-- Requests and replies of services: which of the two a sample is, by the object that sends or hears it.
local requester, replier = {int(ObjectKind.REQUESTER)}, {int(ObjectKind.REPLIER)}
local services = {{
  [{int(SubmessageId.WRITE_DATA)}] = {{ [requester] = "request", [replier] = "reply" }},
  [{int(SubmessageId.DATA)}] = {{ [requester] = "reply", [replier] = "request" }},
}}

local function service(kind, tvb, at, last)
  if services[kind] == nil or at + 4 > last then return nil end
  return services[kind][tvb(at + 3, 1):uint() % 16]
end
{_envelope_code(envelope)}
function xrce.dissector(tvb, pinfo, root)
  local size = tvb:len()
  if size < 4 then return 0 end
{_ENVELOPE_CALL if envelope is not None else ""}  pinfo.cols.protocol = "DDS-XRCE"
  local tree = root:add(xrce, tvb())
  local at = add(tree, header, tvb, 0, 4, true)
  if tvb(0, 1):uint() < {SESSION_NONE} then
    if size < 8 then return size end
    at = add(tree, header_key, tvb, at, 8, true)
  end
  local seen = {{}}
  while at + 4 <= size do
    local kind, set, length = tvb(at, 1):uint(), tvb(at + 1, 1):uint(), tvb(at + 2, 2):le_uint()
    local last = at + 4 + length
    if length == 0 and to_the_end[kind] then last = size end
    -- C clients leave the properties out of the length of CREATE_CLIENT.
    if kind == {int(SubmessageId.CREATE_CLIENT)} then last = size end
    local is_cut = last > size
    if is_cut then last = size end
    local name = names[kind] or string.format("0x%02X", kind)
    local of_service = service(kind, tvb, at + 4, last)
    if of_service then name = name .. " (" .. of_service .. ")" end
    seen[#seen + 1] = name
    local branch = tree:add(xrce, tvb(at, last - at), name)
    add(branch, submessage, tvb, at, at + 4, true)
    for _, flag in ipairs(flags) do
      if flag[3] == nil or flag[3] == kind then branch:add(f["flag_" .. flag[1]], tvb(at + 1, 1)) end
    end
    if of_service then branch:add(f.service, tvb(at + 6, 2), of_service) end
    add(branch, bodies[kind] or {{ {{"rest", 0, "octets"}} }}, tvb, at + 4, last, set % 2 == {LITTLE_ENDIAN})
    if is_cut then branch:add_proto_expert_info(cut) end
    at = last + (-last) % 4
  end
  pinfo.cols.info = table.concat(seen, ", ")
  return size
end

local ports = DissectorTable.get("udp.port")
{registered}
"""


def _all_fields() -> dict[str, LaidField]:
    found: dict[str, LaidField] = {}
    for field in (*HEADER, HEADER_KEY, *SUBMESSAGE, *(one for body in BODIES.values() for one in body)):
        found.setdefault(field.name, field)
    found.setdefault("rest", LaidField("rest", 0, Form.OCTETS))
    return found


_ENVELOPE_CALL = """\
  local inner, around = envelope(tvb, pinfo, root)
  if inner == size then return size end
  if inner > 0 then
    xrce.dissector(tvb(inner):tvb(), pinfo, root)
    pinfo.cols.info = around .. ": " .. tostring(pinfo.cols.info)
    return size
  end
"""


def _envelope_fields(envelope: Envelope) -> dict[str, LaidField]:
    return {field.name: field for _, fields in envelope.kinds.values() for field in fields}


def _envelope_code(envelope: Envelope | None) -> str:
    if envelope is None:
        return ""
    rows = "\n".join(
        f'  [{kind}] = {{ "{word}", {_row(fields)}, {str(kind in envelope.carriers).lower()} }},'
        for kind, (word, fields) in envelope.kinds.items()
    )
    begins = " and ".join(f"tvb({at}, 1):uint() == {octet}" for at, octet in enumerate(envelope.mark))
    at = len(envelope.mark)
    return f"""
local kinds = {{
{rows}
}}

-- Where the message of DDS-XRCE in an envelope begins, and the envelope in words; 0: there is none.
local function envelope(tvb, pinfo, root)
  local size = tvb:len()
  if not ({begins}) then return 0, "" end
  local kind = kinds[tvb({at}, 1):uint()]
  local words = "{envelope.name} " .. (kind and kind[1] or string.format("0x%02X", tvb({at}, 1):uint()))
  pinfo.cols.protocol = "DDS-XRCE"
  pinfo.cols.info = words
  local tree = root:add(xrce, tvb(), words)
  local next = {at + 1}
  if kind then next = add(tree, kind[2], tvb, next, size, false) end
  if kind and kind[3] and next < size then return next, words end
  return size, words
end
"""


def _row(fields: Iterable[LaidField]) -> str:
    return "{ " + ", ".join(f'{{"{field.name}", {field.size}, "{field.form.value}"}}' for field in fields) + " }"


def _proto_field(field: LaidField) -> str:
    name = f'"xrce.{field.name}", "{field.name}"'
    if field.form is Form.TEXT:
        return f"ProtoField.string({name})"
    if field.form is Form.OCTETS:
        return f"ProtoField.bytes({name})"
    base = "base.HEX" if field.is_hexadecimal else "base.DEC"
    words = "" if field.words is None else f", {_lua_words(field.words)}"
    return f"ProtoField.uint{8 * field.size}({name}, {base}{words})"


def _lua_words(words: Mapping[int, str]) -> str:
    return "{ " + ", ".join(f'[{number}] = "{word}"' for number, word in words.items()) + " }"
