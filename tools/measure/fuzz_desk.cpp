// The reader of what a page asks for: the envelope, then the act.
#include <stdexcept>

#include "tools/console/intent_envelope.hpp"
#include "tools/desk/intent.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {

void FuzzReaders::add_desk() {
  readers_.push_back({"desk_intent",
                      {R"({"id":1,"act":"token","holds":["engage","drive"]})",
                       R"({"id":2,"act":"drive","vx":0.3,"vy":-0.1,"wz":0})",
                       R"({"id":3,"act":"mark","points":[[1,0,0],[1.1,0,0.02]]})",
                       R"({"id":4,"act":"go_to","x":1.5,"y":-0.5,"yaw":1.5})",
                       R"({"id":5,"act":"draw","obstacle":{"id":3,"kind":"box","centre":[1,0,0],)"
                       R"("half":[0.2,0.1,0.1],"yaw":0.2}})",
                       R"({"id":6,"act":"note","text":"here"})"},
                      [](const std::string& b) -> rt::Result<bool> {
                        const auto envelope = read_envelope(b);
                        if (!envelope) return rt::Error{envelope.error()};
                        const auto in = read_intent(envelope.value().act, envelope.value().intent);
                        if (!in) return rt::Error{in.error()};
                        if (!in.value().p_W.allFinite() ||
                            in.value().points_W.size() > IntentLimits::kMostPoints)
                          throw std::runtime_error("an intent out of range was taken");
                        return true;
                      },
                      {},
                      true});
}

}  // namespace teletact
