#include "tools/bus/ethercat_parts.hpp"

#include <array>
#include <cstdio>

#include "tools/files/whole_file.hpp"

namespace teletact {

namespace ec = drivers::ethercat;
using Json = nlohmann::ordered_json;

void write_json(const EtherCatOptions& o, const char* what, const Json& content) {
  if (o.json.empty()) return;
  Json all{{"command", std::string("ethercat ") + what}};
  all.update(content);
  write_whole_file(o.json, all.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

std::string hex(std::uint64_t v, int digits) {
  std::array<char, 24> text{};
  std::snprintf(text.data(), text.size(), "0x%0*llX", digits, static_cast<unsigned long long>(v));
  return text.data();
}

void must(const rt::Result<bool>& r) {
  if (!r) throw CouldNotDo(r.error());
}

// From INIT up to `wanted`.
void bring_to(EtherCatSession& bus, ec::AlState wanted) {
  bus.find();
  ec::Master& m = bus.master();
  if (wanted == ec::AlState::kOp) {
    must(m.configure(bus.token()));
    must(m.start(bus.token()));
    return;
  }
  if (wanted == ec::AlState::kSafeOp && !m.problem().empty()) throw CouldNotDo(m.problem());
  constexpr rt::Nanos kStepTime = std::chrono::seconds{2};
  for (const ec::AlState step : {ec::AlState::kPreOp, ec::AlState::kSafeOp}) {
    if (static_cast<int>(step) > static_cast<int>(wanted)) return;
    for (std::size_t i = 0; i < m.slaves().size(); ++i) {
      if (!m.slaves()[i].problem.empty()) continue;  // it stays in INIT, the others may be asked
      const auto& mapping = m.mapping().slaves[i];
      must(step == ec::AlState::kPreOp
               ? ec::to_preop(bus.registers(), m.slaves()[i], mapping, kStepTime)
               : ec::to_safeop(bus.registers(), m.slaves()[i], mapping, kStepTime));
    }
  }
}

}  // namespace teletact
