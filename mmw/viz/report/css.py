"""Style sheet of the report: light and dark by the reader's setting, readable at the width of a phone."""

from mmw.viz.plots.style import BUILDING, ROAD

SERIES_COUNT = 6
"""Colors s0 to s5 of lines, bars and samples; more series begin again."""

COLORS = {
    "page": "#f6f7f9", "card": "#fefefe", "ink": "#1c2128", "muted": "#5a6472", "line": "#d9dee5", "grid": "#e9ecf0",
    "accent": "#0a5fa8", "warn": "#8a4b00", "warnback": "#fff3df", "road": ROAD, "building": BUILDING,
    "other": "#8b94a1", "heat": "#08519c", "s0": "#0072b2", "s1": "#d55e00", "s2": "#00805e", "s3": "#b0508a",
    "s4": "#8a6d00", "s5": "#3c8dbc",
}  # fmt: skip
"""Name of a color -> its value in the light scheme; figures are drawn in these, see `mmw.viz.report.figures`."""

_DARK = {
    "page": "#12151a", "card": "#1b2027", "ink": "#e6e9ee", "muted": "#a2acb9", "line": "#333b46", "grid": "#2a313a",
    "accent": "#6cb6f5", "warn": "#ffc46b", "warnback": "#3a2c12", "road": "#343c47", "building": "#59636f",
    "other": "#8b94a1", "heat": "#7cc4ff", "s0": "#5ab4ee", "s1": "#ff8f5a", "s2": "#3cc79c", "s3": "#e39bc6",
    "s4": "#e8c547", "s5": "#9ad1f2",
}  # fmt: skip

DASHES = ((0, ()), (0, (6, 3)), (0, (2, 2.5)), (0, (8, 3, 2, 3)), (0, (1, 3)), (0, (4, 4)))
"""Dashes of the lines of each series."""


def _variables(colors: dict[str, str]) -> str:
    return ";".join(f"--{name}:{value}" for name, value in colors.items())


def _series() -> str:
    return "".join(
        f"i.s{i}{{background:var(--s{i})}}i.line.s{i}{{background:none;border-top:2.5px "
        f"{'solid' if i == 0 else 'dashed' if i % 2 else 'dotted'} var(--s{i})}}"
        for i in range(SERIES_COUNT)
    )


STYLE = (
    f":root{{color-scheme:light dark;{_variables(COLORS)}}}"
    f"@media(prefers-color-scheme:dark){{:root{{{_variables(_DARK)}}}}}"
    """
*{box-sizing:border-box}
html{-webkit-text-size-adjust:100%}
body{margin:0;background:var(--page);color:var(--ink);
font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,sans-serif}
main,header,footer{max-width:1360px;margin:0 auto;padding:0 20px}
header{padding-top:28px}
footer{padding-bottom:40px;color:var(--muted);font-size:13px}
h1{font-size:28px;line-height:1.2;margin:0 0 4px;overflow-wrap:anywhere}
h2{font-size:21px;margin:40px 0 10px;padding-bottom:6px;border-bottom:1px solid var(--line);overflow-wrap:anywhere}
h3{font-size:16px;margin:26px 0 8px}
h4{font-size:14px;margin:0 0 6px;font-weight:600}
p{margin:8px 0;max-width:86ch}
a{color:var(--accent)}
code,pre{font:12.5px/1.45 ui-monospace,SFMono-Regular,Menlo,Consolas,monospace}
code{overflow-wrap:anywhere}
.lead,.note{color:var(--muted)}
.note{font-size:13px}
.warning{background:var(--warnback);color:var(--warn);border-left:4px solid var(--warn);padding:10px 14px;
border-radius:4px;max-width:none}
nav{display:flex;flex-wrap:wrap;gap:4px 16px;margin:14px 0;font-size:14px}
nav a{overflow-wrap:anywhere}
.tiles{display:flex;flex-wrap:wrap;gap:10px;margin:18px 0}
.tiles div{flex:1 1 200px;background:var(--card);border:1px solid var(--line);border-radius:8px;padding:10px 14px}
.tiles dt{color:var(--muted);font-size:12.5px}
.tiles dd{margin:0;font-size:20px;font-weight:600;font-variant-numeric:tabular-nums;white-space:nowrap}
.scroll{overflow-x:auto;max-width:100%;background:var(--card);border:1px solid var(--line);border-radius:8px;
margin:10px 0}
.scroll:focus-visible{outline:2px solid var(--accent)}
table{border-collapse:collapse;font-size:13.5px;width:100%}
caption{caption-side:bottom;text-align:left;color:var(--muted);padding:6px 12px;font-size:12.5px}
th,td{padding:5px 12px;text-align:left;border-bottom:1px solid var(--grid);vertical-align:top}
th{font-weight:600;color:var(--muted);white-space:nowrap}
td:first-child{white-space:nowrap}
td:nth-child(5):last-child{min-width:250px}
td.n,th.n{text-align:right;white-space:nowrap;font-variant-numeric:tabular-nums}
tbody tr:last-child td{border-bottom:0}
details{background:var(--card);border:1px solid var(--line);border-radius:8px;margin:10px 0;padding:0 14px}
summary{cursor:pointer;padding:9px 0;font-weight:600}
details .scroll,details .sheet{border:0;margin:0 0 10px;padding:0}
pre{overflow:auto;max-height:70vh;margin:0 0 14px;padding:12px;background:var(--page);border-radius:6px}
.grid{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,390px),1fr));gap:14px;margin:10px 0}
.card{background:var(--card);border:1px solid var(--line);border-radius:8px;padding:12px 14px;margin:0;min-width:0}
figcaption{color:var(--muted);font-size:12.5px;margin-top:6px}
.c{display:block;width:100%;height:auto;max-height:640px}
.c *{stroke-linejoin:round;stroke-linecap:butt}
.c text{font-family:system-ui,sans-serif}
.legend{display:flex;flex-wrap:wrap;gap:4px 16px;font-size:13px;color:var(--muted);margin:6px 0}
.legend i{display:inline-block;width:18px;height:10px;margin-right:6px;vertical-align:1px;border-radius:2px}
.legend i.line{height:0;border-radius:0;vertical-align:4px;width:24px}
i.free{background:var(--s2)}i.blocked{background:var(--s1)}i.shade{background:var(--s1);opacity:.25}
i.h1{background:var(--heat);opacity:.2}i.h2{background:var(--heat)}
i.dashed{border-top:2px dashed var(--other)}i.unit{background:var(--ink);clip-path:polygon(50% 0,100% 100%,0 100%)}
.sheet{overflow-x:auto;max-width:100%;background:var(--card);border:1px solid var(--line);border-radius:8px;
margin:10px 0;padding:10px}
.strip{display:flex;gap:8px;align-items:flex-start;width:max-content;margin-bottom:8px}
.strip b{position:sticky;left:0;z-index:1;width:88px;flex:none;font-size:12.5px;background:var(--card);
padding:2px 4px;overflow-wrap:anywhere}
.strip b small{display:block;font-weight:400;color:var(--muted)}
.strip figure{margin:0;width:208px}
.strip img{display:block;width:100%;height:auto;border-radius:4px;background:#14171c;outline:1px solid var(--line)}
.strip figcaption{margin:2px 0 0;font-size:11.5px}
@media(max-width:600px){main,header,footer{padding-left:12px;padding-right:12px}h1{font-size:23px}
.strip figure{width:150px}.strip b{width:64px}.tiles dd{font-size:17px}th,td{padding:5px 9px}
.card{padding:10px}.tiles div{flex-basis:128px}}
@media print{body{background:#fff}.scroll,.sheet{overflow:visible}}
""" + _series()
)
"""The whole style sheet. Nothing in it refers to a file."""
