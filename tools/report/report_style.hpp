// The look of report.html, inline so that the file needs nothing else.
#pragma once

namespace teletact {

inline constexpr const char* kReportStyle = R"css(
:root { color-scheme: light; }
body { margin: 0; font: 15px/1.45 system-ui, "DejaVu Sans", sans-serif; color: #222; background: #f4f5f7; }
header { background: #1f2a36; color: #fff; padding: 18px 28px 12px; }
header h1 { margin: 0; font-size: 22px; font-weight: 600; }
header p { margin: 2px 0 10px; color: #b8c4d0; font-size: 14px; }
nav a { color: #9fd0ff; text-decoration: none; margin-right: 16px; font-size: 14px; }
nav a:hover { text-decoration: underline; }
main { max-width: 1140px; margin: 0 auto; padding: 4px 28px 60px; }
h2 { font-size: 18px; margin: 30px 0 10px; border-bottom: 2px solid #d4d9df; padding-bottom: 4px; }
.verdicts { list-style: none; padding: 0; margin: 0; }
.verdicts li { background: #fff; border-left: 5px solid; margin: 5px 0; padding: 6px 12px; border-radius: 3px; }
.verdicts b { display: inline-block; width: 1.3em; }
.good { border-color: #2e8b57 !important; } .good b { color: #2e8b57; }
.note { border-color: #c98a00 !important; } .note b { color: #c98a00; }
.bad { border-color: #c0392b !important; } .bad b { color: #c0392b; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; background: #fff; margin: 8px 0; font-size: 13.5px; }
caption { text-align: left; font-weight: 600; padding: 6px 0; color: #444; }
th, td { padding: 4px 9px; border-bottom: 1px solid #e5e8ec; text-align: left; white-space: nowrap; }
.numbers td { text-align: right; font-variant-numeric: tabular-nums; }
.numbers thead th { background: #eceff3; border-bottom: 1px solid #cfd5dc; text-align: right; font-weight: 600; }
.numbers thead th:first-child, .numbers th:first-child { text-align: left; }
.numbers thead th[colspan] { text-align: center; border-left: 1px solid #cfd5dc; }
.numbers .t, .numbers thead .t { text-align: left; }
.numbers thead tr + tr th:first-child { text-align: right; }
.numbers .first { border-left: 1px solid #cfd5dc; }
.numbers tbody th, .pairs th { font-weight: 500; }
.pairs td { white-space: pre-wrap; overflow-wrap: anywhere; }
.zero { color: #b5bbc3; }
.alarm { color: #c0392b; font-weight: 600; }
.hint { color: #666; font-size: 13px; max-width: 75em; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(480px, 1fr)); gap: 12px; align-items: start; }
figure { margin: 10px 0; padding: 8px; background: #fff; border-radius: 4px; overflow-x: auto; }
.grid figure { margin: 0; }
figcaption { color: #666; font-size: 13px; padding: 4px 4px 0; }
details { margin: 10px 0; } summary { cursor: pointer; font-weight: 600; color: #345; }
pre { background: #fff; padding: 12px; overflow-x: auto; font-size: 12.5px; line-height: 1.35; border-radius: 4px; }
.cells span { margin-right: 16px; font-size: 13px; }
.cells i { display: inline-block; width: 14px; height: 14px; border: 1px solid #aaa; margin-right: 5px; vertical-align: -2px; }
@media print { body { background: #fff; } details { display: none; } }
)css";

}  // namespace teletact
