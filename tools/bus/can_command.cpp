#include "tools/bus/can_command.hpp"

#include <cmath>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "drivers/can/can_motor_bus.hpp"
#include "drivers/tmcl/tmcl_can.hpp"
#include "drivers/tmcl/tmcl_status.hpp"
#include "tools/bus/ethercat_session.hpp"

namespace teletact {

namespace can = drivers::can;
namespace tmcl = drivers::tmcl;
using Json = nlohmann::ordered_json;

namespace {

void write_can_json(const CanOptions& o, const char* what, CanSession& bus, Json content) {
  const can::PortCounters& n = bus.port().counters();
  content["bus"] = {{"port", to_text(bus.port().state())},
                    {"controller", to_text(bus.port().bus_state())},
                    {"sent", n.sent},
                    {"received", n.received},
                    {"refused", n.refused},
                    {"dropped", n.dropped},
                    {"error_frames", n.error_frames},
                    {"no_acknowledge", n.no_acks},
                    {"bus_offs", n.bus_offs}};
  if (o.json.empty()) return;
  std::ofstream out(o.json);
  out << Json{{"teletact", "can"}, {"command", what}, {"result", content}}.dump(2) << "\n";
  if (!out.flush()) throw std::runtime_error(o.json + ": can not be written");
}

std::string data_text(const can::CanFrame& f) {
  std::string text;
  char byte[8];
  for (const auto b : f.bytes()) {
    std::snprintf(byte, sizeof byte, "%s%02X", text.empty() ? "" : " ", b);
    text += byte;
  }
  return text;
}

can::CanFrame frame_of(int id, const tmcl::Request& q) {
  can::CanFrame f;
  (void)can::fill(f, static_cast<std::uint32_t>(id), tmcl::to_can(q));
  return f;
}

// The reply to `q` of whoever listens to `id`; frames of others pass by.
std::optional<tmcl::Reply> reply_to(CanSession& bus, int id, const tmcl::Request& q, int ms,
                                    std::uint32_t* reply_id = nullptr) {
  tmcl::Reply found;
  const bool came = bus.ask(frame_of(id, q), ms, [&](const can::Received& r) {
    tmcl::Reply reply;
    if (r.frame.id == static_cast<std::uint32_t>(id) || !tmcl::from_can(r.frame.bytes(), reply) ||
        reply.command != q.command)
      return false;
    found = reply;
    if (reply_id != nullptr) *reply_id = r.frame.id;
    return true;
  });
  if (!came) return std::nullopt;
  return found;
}

tmcl::Request parameter_request(const CanOptions& o, bool set) {
  tmcl::Request q;
  using tmcl::Command;
  const Command c = o.global ? (set ? Command::kSetGlobal : Command::kGetGlobal)
                             : (set ? Command::kSetAxisParameter : Command::kGetAxisParameter);
  q.command = static_cast<std::uint8_t>(c);
  q.type = static_cast<std::uint8_t>(o.parameter);
  q.motor = static_cast<std::uint8_t>(o.motor);
  q.value = static_cast<std::int32_t>(o.value);
  return q;
}

int get_or_set(const CanOptions& o, bool set) {
  CanSession bus(o.bus);
  tmcl::Request q = parameter_request(o, set);
  if (!set) q.value = 0;
  const auto reply = reply_to(bus, o.id, q, 10 * o.wait_ms);
  if (!reply) throw CouldNotDo("no reply to identifier " + std::to_string(o.id));
  std::printf("identifier %d, module %u, %s %d: %d, %s\n", o.id, reply->module,
              o.global ? "global parameter" : "parameter", o.parameter, reply->value,
              tmcl::status_text(reply->status));
  write_can_json(o, set ? "set" : "get", bus,
                 {{"id", o.id},
                  {"module", reply->module},
                  {"parameter", o.parameter},
                  {"global", o.global},
                  {"value", reply->value},
                  {"status", reply->status},
                  {"meaning", tmcl::status_text(reply->status)}});
  return tmcl::answers(*reply, q) ? 0 : 1;
}

}  // namespace

int can_scan(const CanOptions& o) {
  CanSession bus(o.bus);
  Json list = Json::array();
  std::printf("identifier reply module type  version\n");
  const auto version = static_cast<std::uint8_t>(tmcl::Command::kFirmwareVersion);
  for (int id = 1; id <= o.last_id; ++id) {
    std::uint32_t reply_id = 0;
    const auto reply = reply_to(bus, id, {0, version, 1, 0, 0}, o.wait_ms, &reply_id);
    if (!reply) continue;
    // Binary form: number of the module, then major and minor version (reference manual 3.35).
    const auto v = static_cast<std::uint32_t>(reply->value);
    std::printf("%10d %5u %6u %5u %u.%02u\n", id, reply_id, reply->module, v >> 16U,
                v >> 8U & 0xFFU, v & 0xFFU);
    list.push_back(
        {{"id", id},
         {"reply_id", reply_id},
         {"module", reply->module},
         {"type", v >> 16U},
         {"version", std::to_string(v >> 8U & 0xFFU) + "." + std::to_string(v & 0xFFU)}});
  }
  std::printf("%zu modules; bus: %s, %s\n", list.size(), to_text(bus.port().state()),
              to_text(bus.port().bus_state()));
  const bool none = list.empty();
  write_can_json(o, "scan", bus, {{"modules", list}});
  return none ? 1 : 0;
}

int can_dump(const CanOptions& o) {
  CanSession bus(o.bus);
  const rt::Time end = bus.now() + rt::nanos_from_seconds(o.for_s);
  const rt::Time begin = bus.now();
  Json list = Json::array();
  while (bus.now() < end) {
    for (const auto& r : bus.wait_1ms()) {
      tmcl::Reply reply;
      const bool message = tmcl::from_can(r.frame.bytes(), reply);
      const double t = rt::seconds(r.at - begin);
      std::printf("%10.6f 0x%03X [%d] %s", t, r.frame.id, r.frame.length,
                  data_text(r.frame).c_str());
      if (message)
        std::printf("   as a reply: module %u, command %u, %s, value %d", reply.module,
                    reply.command, tmcl::status_text(reply.status), reply.value);
      std::printf("\n");
      list.push_back({{"t_s", t}, {"id", r.frame.id}, {"data", data_text(r.frame)}});
    }
  }
  write_can_json(o, "dump", bus, {{"frames", list}});
  return 0;
}

int can_get(const CanOptions& o) { return get_or_set(o, false); }

int can_set(const CanOptions& o) {
  if (!o.yes)
    throw std::runtime_error(
        "a parameter may move a motor: stand clear, then repeat the command with --yes");
  return get_or_set(o, true);
}

int can_serve(const CanOptions& o) {
  if (o.bus.twin) throw std::runtime_error("serve needs --iface: a simulated bus has its modules");
  CanSession bus(o.bus);
  const can::CanMotorConfig config;
  std::vector<can::TmclModule> modules(config.request_ids.size());
  std::vector<double> turns(modules.size());
  for (std::size_t i = 0; i < modules.size(); ++i) {
    modules[i].id = static_cast<std::uint32_t>(config.request_ids[i]);
    modules[i].address = static_cast<std::uint8_t>(config.module_addresses[i]);
  }
  const rt::Time end = bus.now() + rt::nanos_from_seconds(o.for_s);
  std::uint64_t answered = 0;
  for (rt::Time last = bus.now(); bus.now() < end;) {
    const auto frames = bus.wait_1ms();
    const double dt = rt::seconds(bus.now() - last);
    last = bus.now();
    for (std::size_t i = 0; i < modules.size(); ++i) {
      can::TmclModule& m = modules[i];
      m.rpm = m.turning ? m.target_rpm : 0;
      turns[i] += m.rpm / 60.0 * dt;
      m.position = static_cast<std::int32_t>(
          std::llround(std::fmod(turns[i], 1e5) * config.ticks_per_motor_turn));
    }
    for (const auto& r : frames) {
      for (can::TmclModule& m : modules) {
        tmcl::Request q;
        tmcl::Reply reply;
        bool text = false;
        if (m.id != r.frame.id || !tmcl::from_can(r.frame.bytes(), q) || !m.answer(q, reply, text))
          continue;
        can::CanFrame f;
        (void)can::fill(f, m.reply_id, tmcl::to_can(reply));
        answered += static_cast<std::uint64_t>(bus.port().send(bus.now(), {&f, 1}));
      }
    }
  }
  std::printf("%llu replies\n", static_cast<unsigned long long>(answered));
  return 0;
}

}  // namespace teletact
