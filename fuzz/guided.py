"""The parsers, guided by what their code does: `python -m fuzz.guided PARSER --seconds N`, with atheris.

Atheris (`pip install atheris`; Linux, no dependency of MsBOT) notes which branches an input reaches, and libFuzzer
keeps the inputs that reach new ones: they get through checks that chance alone does not pass. What is found is stored
as `python -m fuzz` stores it, and replayed in the same way.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fuzz.case import Finding, Step, store

FINDINGS = Path(__file__).parent / "findings"  # not from __main__, which loads msbot before it can be instrumented
MOST_OCTETS = 8192
"""Of an input, unless what is right is longer: a backup that is cut off is no database."""
SLOW_S = 20


def main(arguments: list[str] | None = None) -> int:
    """Fuzz one parser; returns 2 when that is not possible. Otherwise libFuzzer ends the process."""
    parser = argparse.ArgumentParser(prog="python -m fuzz.guided", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("parser", help="a parser of fuzz/targets/parsers.py, or a decoder of fuzz/targets/codec.py")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--findings", type=Path, default=FINDINGS)
    options = parser.parse_args(arguments)
    try:
        import atheris
    except ImportError:
        print("this needs atheris: pip install atheris (Linux); without it: python -m fuzz parsers", file=sys.stderr)
        return 2
    with atheris.instrument_imports(include=["msbot"]):
        from fuzz.targets.codec import _DECODERS as decoders
        from fuzz.targets.codec import CodecTarget
        from fuzz.targets.parsers import PARSERS, ParserTarget, samples_of
    if options.parser not in (*PARSERS, *decoders):
        print(f"no such parser: {options.parser}; known: {', '.join((*PARSERS, *decoders))}", file=sys.stderr)
        return 2
    target = ParserTarget(options.parser) if options.parser in PARSERS else CodecTarget()
    _run(atheris, options, target, samples_of(options.parser) if options.parser in PARSERS else ())
    return 0


def _run(atheris: Any, options: argparse.Namespace, target: Any, right: tuple[bytes, ...]) -> None:  # noqa: ANN401 - atheris has no types
    from random import Random

    random = Random(options.seed)
    corpus = Path(tempfile.mkdtemp(prefix="msbot-corpus-"))
    made = [step.data for (step,) in (target.make(random) for _ in range(200)) if step.verb == options.parser]
    most = max(MOST_OCTETS, *map(len, right), 0)
    for number, octets in enumerate((*right, *made)):
        (corpus / str(number)).write_bytes(octets[:most])
    words = [
        f"-max_total_time={options.seconds}",
        f"-max_len={most}",
        f"-timeout={SLOW_S}",
        "-verbosity=1",
        f"-seed={options.seed}",
        "-print_final_stats=1",
    ]
    atheris.Setup([sys.argv[0], *words, str(corpus)], _trier(target, options))
    atheris.Fuzz()


def _trier(target: Any, options: argparse.Namespace) -> Callable[[bytes], None]:  # noqa: ANN401 - as above
    import traceback

    from fuzz.engine import signature

    known: set[str] = set()

    def try_out(octets: bytes) -> None:
        case = (Step(options.parser, octets),)
        try:
            list(target.run(case))
        except Exception as error:  # what comes out is the finding: it is stored, and the search goes on
            words = signature(error)
            if words not in known:
                known.add(words)
                path = store(Finding(target.name, words, traceback.format_exc(), case), options.findings, options.seed)
                print(f"FOUND {words}\n    python -m fuzz --replay {path}", flush=True)

    return try_out


if __name__ == "__main__":
    sys.exit(main())
