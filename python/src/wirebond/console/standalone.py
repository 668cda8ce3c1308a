"""A page without a server: the console for one protocol as static files, and what its worker needs of the protocol.

``Facts`` in console/src/page/facts.ts has the shapes. The worker has the engine (engine/wasm), which reads the same
tables as the engine of Python does.
"""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

from wirebond import __version__, paths
from wirebond.as_json import plain
from wirebond.chinese import SENTENCES, text_of
from wirebond.codec import Codec
from wirebond.console.jobs.protocol_files import document, findings
from wirebond.console.protocol_form import protocol_form
from wirebond.errors import UsageError
from wirebond.link.devices.port_name import ADAPTER_LATENCY
from wirebond.link.ends import actions_at
from wirebond.link.log_lines import log_names
from wirebond.link.peer import HELLO_VERSION
from wirebond.link.raw import is_raw
from wirebond.link.service_values import filled
from wirebond.link.settings import STOP_EVERY, engine_settings
from wirebond.protocol.meaning.log_text import Shown, log_pieces
from wirebond.protocol.model import End, Field, GivenMessage, Message, PartKind
from wirebond.protocol.model.forms import FormParts, header_fields, header_names, parts_of_forms
from wirebond.protocol.planning import plan_for, told_by_request
from wirebond.protocol.replies import carried_back, identifying
from wirebond.protocol.tables import session_table
from wirebond.recording.history.source import ENDS, Source

VERSION = 3
TABLES = "protocol.json"
_ENGINE = "engine.wasm"
_INDEX = "index.html"
_MARK = '<div id="app"></div>'
# The browser itself forbids the page to send anything anywhere, and to load anything from elsewhere.
_POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' blob:; worker-src 'self' blob:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self'; base-uri 'none'; "
    "form-action 'none'"
)


def page_files(codec: Codec) -> dict[str, bytes]:
    """Return the files of the page, by their names: a folder for a web server, and ``NAME.html``, which is all of it in
    one.

    :raises UsageError: the page or its engine was not built, or the protocol was not read from a file.
    """
    if not (paths.PAGE / _INDEX).exists() or not paths.ENGINE_FOR_PAGES.exists():
        raise UsageError(
            "the console's page, or its engine for browsers, was not built; run "
            "`make page build/wasm.stamp` in the clone, with Node 20.19 or newer; or install a wheel, which has both"
        )
    if is_raw(codec) or not codec.model.text:
        raise UsageError("a page is for a protocol that was read from a file; name the file")
    engine = paths.ENGINE_FOR_PAGES.read_bytes()
    tables = _json(facts(codec))
    files = {
        path.relative_to(paths.PAGE).as_posix(): path.read_bytes()
        for path in sorted(paths.PAGE.rglob("*"))
        if path.is_file()
    }
    index = files[_INDEX].decode()
    whole = _in_one(index, files, engine, tables)
    files[_INDEX] = _with_config(index, {"protocol": TABLES, "engine": _ENGINE}).encode()
    files[TABLES] = tables
    files[_ENGINE] = engine
    files[f"{codec.name}.html"] = whole.encode()
    return files


def _json(value: Any) -> bytes:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode()


def _with_config(index: str, config: dict[str, Any]) -> str:
    # No text of the protocol can end the element: `<` is written as JSON may write it.
    text = _json(config).decode().replace("<", "\\u003c")
    policy = f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}" />'
    element = f'<script type="application/json" id="wirebond-page">{text}</script>'
    return index.replace("<head>", f"<head>\n    {policy}", 1).replace(_MARK, f"{_MARK}\n    {element}", 1)


def _in_one(index: str, files: dict[str, bytes], engine: bytes, tables: bytes) -> str:
    """Return the page as one document, which a browser opens from disk."""
    worker = next(data for name, data in files.items() if re.fullmatch(r"assets/worker-.*\.js", name))
    inline = {"engine": base64.b64encode(engine).decode(), "worker": base64.b64encode(worker).decode()}
    config = {"protocol": json.loads(tables), "engine": "", "inline": inline}

    def script(found: re.Match[str]) -> str:
        text = files[found[1].removeprefix("./")].decode().replace("</script", "<\\/script")
        return f'<script type="module">{text}</script>'

    def style(found: re.Match[str]) -> str:
        return f"<style>{files[found[1].removeprefix('./')].decode()}</style>"

    whole = _with_config(index, config)
    whole = re.sub(r'<link rel="stylesheet"[^>]*href="([^"]+)"[^>]*>', style, whole)
    found = re.search(r'\s*<script type="module"[^>]*src="([^"]+)"[^>]*></script>', whole)
    assert found is not None, "the page has no script"
    # After the configuration, which the script reads when it begins.
    whole = whole[: found.start()] + whole[found.end() :]
    return whole.replace("</body>", f"{script(found)}\n  </body>", 1)


# ---- the worker's part of the protocol


def facts(codec: Codec) -> dict[str, Any]:
    """Return all facts for JSON.

    :param codec: of the protocol.
    """
    model = codec.model
    plans = {end: plan_for(model, end) for end in ENDS}
    source = Source(codec, End.HOST, model.idle_seconds)
    settings = engine_settings(codec, model.link.baud, adapter_latency=ADAPTER_LATENCY)
    messages = {message.name: message for message in model.messages}
    told: dict[str, Any] = plain(
        {
            "version": VERSION,
            "wirebond": __version__,
            "protocol": protocol_form(codec, source.history, Path(model.path).name, "", model.link.baud),
            "document": document(model.text, model.path),
            "lint": findings(model.text, model.path),
            "tables": base64.b64encode(session_table(model, ADAPTER_LATENCY)).decode(),
            "link": base64.b64encode(settings.table()).decode(),
            "adapter_latency": ADAPTER_LATENCY,
            "actions": actions_at(codec, End.HOST),
            "delimiters": {end.value: sorted({*plan.opening, *plan.closing}) for end, plan in plans.items()},
            "forms": {end.value: [_form(form) for form in parts_of_forms(model.format.parts, end)] for end in ENDS},
            "told": bool(told_by_request(model.messages, End.MCU)),
            "requests": {
                message.name: _request(message, messages[message.reply])
                for message in model.messages
                if message.reply is not None and message.sent_by(End.HOST)
            },
            "stops": [_stop(codec, stop) for stop in model.emergency_stop],
            "address": _address(codec),
            "log": {name: _log(messages[name]) for name in log_names(codec)},
            "hello": _hello(codec),
            "chinese": text_of(*SENTENCES, "page"),
        }
    )
    return told


def _form(form: FormParts) -> list[dict[str, Any]]:
    """Return the parts of a frame of this form, in the order of the wire."""
    return [
        {
            "name": part.name,
            "size": None if part.kind == PartKind.PAYLOAD else part.size,
            "header": header_names(part),
            "is_id": part.kind == PartKind.ID,
        }
        for part in form.parts
    ]


def _request(message: Message, reply: Message) -> dict[str, Any]:
    return {
        "reply": reply.name,
        "carried": carried_back(reply, message),
        "identifying": identifying(reply, message),
    }


def _stop(codec: Codec, stop: GivenMessage) -> dict[str, Any]:
    return {
        "message": stop.message,
        "fields": dict(stop.fields),
        "header": dict(stop.header),
        "every": codec.model.message(stop.message).every or STOP_EVERY,
        "covered": codec.tables.address_of(dict(stop.header)) in codec.tables.broadcasts,
    }


def _address(codec: Codec) -> dict[str, Any]:
    host, mcu = plan_for(codec.model, End.HOST), plan_for(codec.model, End.MCU)
    fields = header_fields(codec.model.format.parts)
    return {
        "place": host.address,
        "names": [field.name for field in fields if field.address is not None],
        "numbers": [field.name for field in fields if field.is_sequence],
        "from": None if mcu.peer is None else mcu.header[mcu.peer].name,
        "broadcasts": list(codec.tables.broadcasts),
    }


def _log(message: Message) -> dict[str, Any]:
    if message.log is None:
        return {"level": "info", "pieces": None}
    fields = {field.name: field for field in message.fields}
    pieces = [
        {"field": piece.field, "decimals": _decimals(fields[piece.field])} if isinstance(piece, Shown) else piece
        for piece in log_pieces(message.log)
    ]
    return {"level": message.log_level, "pieces": pieces}


def _decimals(field: Field) -> int | None:
    if not field.is_scaled or field.is_float:
        return None
    return max(len(f"{float(part):.9f}".rstrip("0").partition(".")[2]) for part in (field.scale, field.offset))


def _hello(codec: Codec) -> dict[str, Any] | None:
    service = codec.model.service("hello")
    name = None if service is None else service.message("message")
    if name is None:
        return None
    fields = filled(codec.model.message(name), {"protocol_hash": 0, "version": HELLO_VERSION})
    return {"message": name, "fields": fields}
