// The readers of what a page asks for, the envelope and then the act, and of a saved session.
#include <stdexcept>

#include "tools/console/intent_envelope.hpp"
#include "tools/desk/intents/intent.hpp"
#include "tools/desk/saved_session.hpp"
#include "tools/measure/fuzz_readers.hpp"

namespace teletact {

void FuzzReaders::add_desk() {
  readers_.push_back(
      {"desk_intent",
       {R"({"id":1,"act":"token","holds":["engage","drive"]})",
        R"({"id":2,"act":"drive","vx":0.3,"vy":-0.1,"wz":0})",
        R"({"id":3,"act":"mark","points":[[1,0,0],[1.1,0,0.02]]})",
        R"({"id":4,"act":"go_to","x":1.5,"y":-0.5,"yaw":1.5})",
        R"({"id":5,"act":"draw","obstacle":{"id":3,"kind":"box","centre":[1,0,0],)"
        R"("half":[0.2,0.1,0.1],"yaw":0.2}})",
        R"({"id":6,"act":"note","text":"here"})", R"({"id":7,"act":"save","name":"lab-1"})",
        R"({"id":8,"act":"open","name":"lab-1"})",
        R"({"id":9,"act":"device","scale":2,"clutch":true,"view_yaw":0.5})",
        R"({"id":10,"act":"record","on":true})",
        R"({"id":11,"act":"accept","proposal":4,"name":"bin"})"},
       [](const std::string& b) -> rt::Result<bool> {
         const auto envelope = read_envelope(b);
         if (!envelope) return rt::Error{envelope.error()};
         const auto in = read_intent(envelope.value().act, envelope.value().intent);
         if (!in) return rt::Error{in.error()};
         if (!in.value().p_W.allFinite() ||
             in.value().points_W.size() > IntentLimits::kMostPoints ||
             (in.value().act == Act::kSave && !is_session_name(in.value().text)))
           throw std::runtime_error("an intent out of range was taken");
         return true;
       },
       {},
       true});
  SavedSession lab;
  lab.world = "0123456789abcdef";
  lab.saved = "2026-01-02T03:04:05Z";
  lab.obstacles.emplace_back();
  lab.obstacles.back().id = 3;
  lab.obstacles.back().half_m = {0.2, 0.2, 0.1};
  lab.marks_W = {{{0.1, 0.2, 0}, {0.15, 0.2, 0}}};
  SavedObject& bin = lab.objects.emplace_back();
  bin.name = "bin";
  bin.object.boxes_W[0] = {perception::Vec3(0.9, 0.9, 0), perception::Vec3(1.1, 1.1, 0.3)};
  bin.object.count = 1;
  bin.object.p_W = {1, 1, 0.2};
  readers_.push_back({"saved_session",
                      {session_text(lab)},
                      [](const std::string& b) -> rt::Result<bool> {
                        const auto session = read_session("lab", b);
                        if (!session) return rt::Error{session.error()};
                        for (const DrawnObstacle& o : session.value().obstacles)
                          if (!o.centre_W.allFinite() || !(o.half_m.minCoeff() > 0))
                            throw std::runtime_error("a keep-out out of range was taken");
                        for (const SavedObject& o : session.value().objects)
                          if (!o.object.contains(o.object.p_W))
                            throw std::runtime_error("an object without its point was taken");
                        return true;
                      },
                      {},
                      true});
}

}  // namespace teletact
