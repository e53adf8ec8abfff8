// What an audit says: tables on the terminal, figures, a report page, a file of events.
#pragma once

#include <string>
#include <vector>

#include "tools/audit/audit_input.hpp"
#include "tools/files/metrics_json.hpp"
#include "tools/report/report.hpp"

namespace teletact {

// Both tables of all tasks; adds their figures. What speaks against a task, one line each; empty:
// all kept their budgets and none missed by itself.
[[nodiscard]] std::vector<std::string> print_tasks(const std::vector<AuditedTask>&, Metrics&);
// What each black box holds.
void print_boxes(const AuditInput&, Metrics&);
// What each log says of itself; adds how many records were lost.
void print_notes(const std::vector<rt::RunLog>&, Metrics&);

[[nodiscard]] ReportData audit_report(const std::string& command, const std::vector<AuditedTask>&,
                                      const std::vector<rt::RunLog>&,
                                      const std::vector<std::string>& against, const Metrics&);

// CSV, a line an event.
void write_events(const std::string& path, const std::vector<AuditedTask>&,
                  const std::vector<rt::StoreEvent>& box_events);

}  // namespace teletact
