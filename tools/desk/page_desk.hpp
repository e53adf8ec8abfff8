// A run with a page: the server of tools/console and the desk, opened in the process that holds the
// operator's box. What `teletact demo --console` and `teletact operator --console` add.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "tools/console/console_server.hpp"
#include "tools/desk/browser_door.hpp"
#include "tools/desk/code_offer.hpp"
#include "tools/desk/desk.hpp"
#include "tools/scene/page_hook.hpp"

namespace teletact {

struct PageOptions {
  ConsoleOptions server;
  DeskOptions desk;
  bool open_browser = false;
  bool hand = true;     // false: a device's hand is never replaced by the page's
  std::string figures;  // file for console.* of docs/metrics.md, at the end; empty: none
  bool quiet = false;   // the URL goes to no terminal
  // Tests and tools: the URL with its code; again with each new one (code_offer.hpp).
  std::function<void(const std::string& url)> tell;
};

class PageDesk final : public PageHook {
 public:
  explicit PageDesk(PageOptions options) : options_(std::move(options)) {}
  ~PageDesk() override { shut(); }
  [[nodiscard]] drivers::HapticDevice* hand_over(rt::NonRealtime& nrt,
                                                 drivers::HapticDevice& device) override;
  // Throws std::runtime_error with one line where the server does not start.
  void open(OperatorBox& box, OperatorConsole& console, const Scene& scene, rt::Time epoch,
            Clock clock) override;
  void tasks(const rt::RunLog& header) override { tasks_.tasks(header); }
  void job(const rt::JobRecord& record) override { tasks_.add(record); }
  void sentinel(const rt::SentinelRecord& record) override { tasks_.add(record); }
  void tick(rt::Time now) override;
  [[nodiscard]] bool await_acts(rt::Nanos most) override;
  void take_acts(rt::Time now) override;
  void close() override;
  [[nodiscard]] std::int64_t cpu_ns() const override {
    return server_ ? server_->counts().cpu_ns : 0;
  }

 private:
  void shut();
  [[nodiscard]] double clock_s() const;
  void keep_clock(rt::Time now);
  static void say_no_browser();
  void offer_again();
  void write_figures() const;
  void write_maps() const;
  [[nodiscard]] DeskPort port();
  [[nodiscard]] ConsoleCallbacks callbacks();
  PageOptions options_;
  static constexpr std::int64_t kNoTick = INT64_MAX;
  std::atomic<double> now_s_{0};
  std::atomic<std::int64_t> ahead_ns_{kNoTick};  // the machine's clock before the box's
  rt::Time epoch_{};
  OperatorBox* box_ = nullptr;  // while it stands
  TaskWatch tasks_;
  // The server calls the desk, the desk the server: it is made first, and ends first.
  std::unique_ptr<PageHand> hand_;
  std::unique_ptr<ConsoleServer> server_;
  std::unique_ptr<Desk> desk_;
  BrowserDoor door_;
  std::optional<CodeOffer> offer_;
  std::atomic<bool> open_{false};
};

}  // namespace teletact
