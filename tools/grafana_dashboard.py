"""Writes examples/grafana/msbot.json, a dashboard for the figures of `msbot master --metrics`.

It is made with Grafana's own library for dashboards (`grafana-foundation-sdk`), so that it has the form that Grafana
reads: `python tools/grafana_dashboard.py`.
"""

from __future__ import annotations

import json
from pathlib import Path

from grafana_foundation_sdk.builders import common, dashboard, heatmap, prometheus, stat, timeseries
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models.common import StackingMode
from grafana_foundation_sdk.models.dashboard import DataSourceRef

FILE = Path(__file__).parent.parent / "examples" / "grafana" / "msbot.json"
SOURCE = DataSourceRef(type_val="prometheus", uid="${source}")
ROBOTS = '{job=~"$job",instance=~"$instance"}'

STATS = (
    ("Parts in the robot", 'sum(msbot_parts{state=~"active|late",job=~"$job",instance=~"$instance"})', "short"),
    ("Slots", f"sum(msbot_slots{ROBOTS})", "short"),
    ("Robots under STOP", f"sum(msbot_stopped{ROBOTS})", "short"),
    ("Sessions", f"sum(msbot_sessions{ROBOTS})", "short"),
    ("Changes that wait to be stored", f"sum(msbot_database_waiting{ROBOTS})", "short"),
    ("People on the page", f"sum(msbot_page_sessions{ROBOTS})", "short"),
)


def _rates(histogram: str) -> str:
    return f"sum by (le, instance) (rate({histogram}_bucket{ROBOTS}[$__rate_interval]))"


CURVES = (
    ("Parts by state", (f"sum by (state) (msbot_parts{ROBOTS})", "{{state}}"), "short", True),
    ("Bus load", (f"msbot_bus_load_ratio{ROBOTS}", "{{instance}} {{bus}}"), "percentunit", False),
    ("Samples that parts wrote", (f"sum by (topic) (rate(msbot_topic_published_total{ROBOTS}[$__rate_interval]))",
                                  "{{topic}}"), "cps", False),
    ("Packets", (f"sum by (link, direction) (rate(msbot_link_packets_total{ROBOTS}[$__rate_interval]))",
                 "{{link}} {{direction}}"), "pps", False),
    ("Losses on links, by reason", (f"sum by (reason) (rate(msbot_link_lost_total{ROBOTS}[$__rate_interval]))",
                                    "{{reason}}"), "cps", False),
    ("Packets that belonged to no session",
     (f"sum by (reason) (rate(msbot_agent_lost_total{ROBOTS}[$__rate_interval]))", "{{reason}}"), "cps", False),
    ("Beats of parts", (f"rate(msbot_beats_total{ROBOTS}[$__rate_interval])", "{{instance}}"), "cps", False),
    ("Event loop: 99 % are less late than",
     (f"histogram_quantile(0.99, {_rates('msbot_loop_delay_seconds')})", "{{instance}}"), "s", False),
    ("Samples: 99 % are through the master within",
     (f"histogram_quantile(0.99, {_rates('msbot_sample_latency_seconds')})", "{{instance}}"), "s", False),
    ("Messages: 99 % are acknowledged within",
     (f"histogram_quantile(0.99, {_rates('msbot_acknowledgement_seconds')})", "{{instance}}"), "s", False),
    ("Memory", (f"process_resident_memory_bytes{ROBOTS}", "{{instance}}"), "bytes", False),
    ("Processor", (f"rate(process_cpu_seconds_total{ROBOTS}[$__rate_interval])", "{{instance}}"), "percentunit", False),
)  # fmt: skip
INTERVALS = f"sum by (le) (increase(msbot_beat_interval_seconds_bucket{ROBOTS}[$__rate_interval]))"


def build() -> str:
    """The dashboard as JSON."""
    board = (
        dashboard.Dashboard("MsBOT")
        .uid("msbot")
        .tags(["msbot", "robots"])
        .refresh("10s")
        .time("now-30m", "now")
        .with_variable(dashboard.DatasourceVariable("source").label("Prometheus").type("prometheus"))
        .with_variable(_variable("job", "label_values(msbot_sessions, job)"))
        .with_variable(_variable("instance", 'label_values(msbot_sessions{job=~"$job"}, instance)'))
    )
    for title, question, unit in STATS:
        board.with_panel(
            stat.Panel().title(title).datasource(SOURCE).unit(unit).span(4).height(4).with_target(_asked(question, ""))
        )
    for title, (question, legend), unit, stacked in CURVES:
        panel = timeseries.Panel().title(title).datasource(SOURCE).unit(unit).span(12).height(8).min(0)
        if stacked:
            panel.stacking(common.StackingConfig().mode(StackingMode.NORMAL)).fill_opacity(40)
        board.with_panel(panel.with_target(_asked(question, legend)))
    board.with_panel(
        heatmap.Panel()
        .title("Time between two beats of a part")
        .datasource(SOURCE)
        .span(24)
        .height(8)
        .with_target(_asked(INTERVALS, "{{le}}").format("heatmap"))
    )
    made = json.loads(JSONEncoder().encode(board.build()))
    return json.dumps(_without_none(made), sort_keys=True, indent=2) + "\n"


def _without_none(content: object) -> object:
    """What is not said is left out: Grafana puts its own defaults there, and takes null for a value."""
    if isinstance(content, dict):
        return {key: _without_none(value) for key, value in content.items() if value is not None}
    return [_without_none(value) for value in content] if isinstance(content, list) else content


def _asked(question: str, legend: str) -> prometheus.Dataquery:
    return prometheus.Dataquery().expr(question).legend_format(legend)


def _variable(name: str, question: str) -> dashboard.QueryVariable:
    return (
        dashboard.QueryVariable(name)
        .label(name)
        .datasource(SOURCE)
        .query(question)
        .multi(True)
        .include_all(True)
        .all_value(".+")
    )


if __name__ == "__main__":
    FILE.write_text(build(), encoding="utf-8")
