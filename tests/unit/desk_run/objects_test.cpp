// A person at the page marks the bin of the default room by clicks: what is proposed against what
// the picture truly shows, then the object that fusion makes of it, and the same again from the
// recording.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <nlohmann/json.hpp>

#include "drivers/world/world.hpp"
#include "perception/segmentation/measures.hpp"
#include "tests/unit/desk_run/person.hpp"

namespace {

using desk_run::Person;
using nlohmann::json;
using perception::Intrinsics;
using perception::Pose;
using perception::Vec3;
using Mask = std::vector<std::uint8_t>;

template <class T>
T at(const std::vector<std::uint8_t>& bytes, std::size_t offset) {
  T out{};
  std::memcpy(&out, bytes.data() + offset, sizeof out);
  return out;
}

struct Eye {
  Intrinsics k;
  Pose X_WC = Pose::Identity();
};

// Of a view `picture`: docs/console_protocol.md.
Eye eye_of(const std::vector<std::uint8_t>& body) {
  Eye e;
  e.k = {static_cast<double>(at<float>(body, 4)),
         static_cast<double>(at<float>(body, 8)),
         static_cast<double>(at<float>(body, 12)),
         static_cast<double>(at<float>(body, 16)),
         at<std::uint16_t>(body, 0),
         at<std::uint16_t>(body, 2)};
  const auto number = [&](std::size_t n) { return at<double>(body, 20 + 8 * n); };
  e.X_WC.translation() = Vec3(number(0), number(1), number(2));
  e.X_WC.linear() =
      Eigen::Quaterniond(number(3), number(4), number(5), number(6)).toRotationMatrix();
  return e;
}

Mask truth_of(const drivers::World& world, int shape, const Eye& e) {
  Mask out;
  for (int v = 0; v < e.k.height; ++v)
    for (int u = 0; u < e.k.width; ++u) {
      const Vec3 d_W = e.X_WC.linear() * e.k.unproject(u, v, 1.0);
      out.push_back(world.ray_cast(e.X_WC.translation(), d_W).shape == shape ? 1 : 0);
    }
  return out;
}

Mask selected(const std::vector<std::uint8_t>& body) {
  const std::size_t n =
      static_cast<std::size_t>(at<std::uint16_t>(body, 0)) * at<std::uint16_t>(body, 2);
  EXPECT_EQ(body.size(), 8 + (n + 7) / 8);
  Mask out;
  for (std::size_t i = 0; i < n; ++i)
    out.push_back(static_cast<std::uint8_t>((body[8 + i / 8] >> (i % 8)) & 1U));
  return out;
}

double iou(const Mask& a, const Mask& b) {
  if (a.size() != b.size()) return 0;
  double both = 0, either = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    both += a[i] != 0 && b[i] != 0 ? 1 : 0;
    either += a[i] != 0 || b[i] != 0 ? 1 : 0;
  }
  return either > 0 ? both / either : 0;
}

// The pixel of a mask that is farthest from all that is not of it.
std::size_t middle_of(const Mask& mask, const Intrinsics& k) {
  Mask others;
  for (int i = 0; i < k.width * k.height; ++i) {
    const int u = i % k.width, v = i / k.width;
    const bool rim = u == 0 || v == 0 || u == k.width - 1 || v == k.height - 1;
    others.push_back(rim || mask[static_cast<std::size_t>(i)] == 0 ? 1 : 0);
  }
  const auto far = perception::squared_distance(others, k.width, k.height);
  return static_cast<std::size_t>(std::max_element(far.begin(), far.end()) - far.begin());
}

// Clicks by rule: the first in the truth's middle, each further one in the middle of the largest
// error.
class Clicker {
 public:
  Clicker(Person& p, const drivers::World& world, int shape)
      : p_(p), world_(world), shape_(shape) {}

  // True: as many as were wanted are answered.
  bool click(double t, int wanted) {
    if (id_ != 0) {
      const auto said = p_.answers.find(id_);
      if (said == p_.answers.end()) return false;
      EXPECT_TRUE(said->second.ok) << said->second.why;
      if (!said->second.ok) return true;
      proposal = json::parse(said->second.result)["proposal"].get<std::uint32_t>();
      mask_ = selected(p_.selection);
      ious.push_back(iou(mask_, truth_));
      std::printf("click %zu at %.2f s: IoU %.3f, %s\n", ious.size(), t, ious.back(),
                  said->second.result.c_str());
      id_ = 0;
    }
    if (static_cast<int>(ious.size()) >= wanted) return true;
    Mask wrong = truth_;
    if (ious.empty()) {
      eye_ = eye_of(p_.picture);
      wrong = truth_ = truth_of(world_, shape_, eye_);
    } else {
      for (std::size_t i = 0; i < wrong.size(); ++i) wrong[i] = truth_[i] != mask_[i] ? 1 : 0;
    }
    const std::size_t pixel = middle_of(wrong, eye_.k);
    const auto width = static_cast<std::size_t>(eye_.k.width);
    id_ = p_.say({{"act", "select"},
                  {"u", (static_cast<double>(pixel % width) + 0.5) / eye_.k.width},
                  {"v", (static_cast<double>(pixel / width) + 0.5) / eye_.k.height},
                  {"sign", truth_[pixel] != 0 ? 1 : -1},
                  {"new", ious.empty()}});
    return false;
  }
  std::vector<double> ious;  // after each click
  std::uint32_t proposal = 0;

 private:
  Person& p_;
  const drivers::World& world_;
  int shape_;
  std::int64_t id_ = 0;
  Eye eye_;
  Mask truth_, mask_;
};

// Of the bin in the view that fusion draws, from where the view's eye is.
double view_iou(const tasks::SceneView& view, const drivers::World& world, int shape) {
  const Mask truth = truth_of(world, shape, {view.intrinsics, view.X_WV});
  Mask said;
  for (std::size_t i = 0; i < truth.size(); ++i) said.push_back(view.object[i] != 0 ? 1 : 0);
  return iou(truth, said);
}

TEST(DeskRun, TheBinIsAnObjectByThreeClicksAndReplays) {
  auto s = desk_run::scene({"fusion.objects.enabled=true"});
  rt::Startup nrt;
  const drivers::World world(nrt.token(), s->world);
  const int bin = world.find("bin");
  ASSERT_GE(bin, 0);
  Person p;
  p.viewers = 1;
  Clicker clicker(p, world, bin);
  std::int64_t early = 0, stale = 0, accept = 0, again = 0, undo = 0;
  double accepted_at = -1, drawn = 0;
  json named;
  p.act = [&](double t) {
    if (p.once("early", t, 0.0))
      early = p.say({{"act", "select"}, {"u", 0.5}, {"v", 0.5}, {"sign", 1}, {"new", false}});
    if (t < 2.0 || p.picture.empty() || !clicker.click(t, 3)) return;
    if (p.once("stale", t, 0))
      stale = p.say({{"act", "accept"}, {"proposal", clicker.proposal + 1}});
    if (p.once("accept", t, 0))
      accept = p.say({{"act", "accept"}, {"proposal", clicker.proposal}, {"name", "bin"}});
    if (accepted_at < 0 && p.answers.count(accept) > 0) accepted_at = t;
    if (accepted_at < 0) return;
    if (p.once("again", t, accepted_at))
      again = p.say({{"act", "accept"}, {"proposal", clicker.proposal}});
    if (p.once("look", t, accepted_at + 1.5)) {
      drawn = view_iou(*p.seen().view, world, bin);
      named = json::parse(p.text)["objects"];
      undo = p.say({{"act", "undo"}});
    }
  };
  teletact::DemoOptions options;
  options.report = (desk_run::folder() / "objects").string();
  options.record = true;
  options.log_folder = options.report + "/raw";
  const teletact::VirtualRun r = desk_run::run(*s, 9, p, options);
  ASSERT_EQ(clicker.ious.size(), 3U);
  EXPECT_GE(clicker.ious.front(), 0.8);
  EXPECT_GE(clicker.ious.back(), 0.8);
  EXPECT_EQ(p.views[teletact::ViewKind::kSelection], 3);
  EXPECT_FALSE(p.answers[early].ok) << "nothing was chosen before";
  EXPECT_FALSE(p.answers[stale].ok);
  ASSERT_TRUE(p.answers[accept].ok) << p.answers[accept].why;
  EXPECT_FALSE(p.answers[again].ok) << "it is accepted";
  EXPECT_TRUE(p.answers[undo].ok) << p.answers[undo].why;
  std::printf("accepted at %.2f s; IoU in fusion's view 1.5 s later %.3f\n", accepted_at, drawn);
  EXPECT_GE(drawn, 0.7);
  ASSERT_EQ(named.size(), 1U);
  EXPECT_EQ(named[0]["name"], "bin");
  // Its near half was seen.
  EXPECT_NEAR(named[0]["centre"][0].get<double>(), 2.65, 0.17);
  EXPECT_NEAR(named[0]["centre"][1].get<double>(), -0.30, 0.10);
  EXPECT_TRUE(p.desk->acts().first_steps().object);
  EXPECT_EQ(r.op.view.objects.size, 0) << "taken back";
  EXPECT_TRUE(json::parse(p.text)["objects"].empty());
  EXPECT_TRUE(desk_run::same_again(options.log_folder, rt::Box::kOperator));
}

TEST(DeskRun, WithoutObjectsAProposalIsShownAndAcceptingItIsRefused) {
  auto s = desk_run::scene();
  rt::Startup nrt;
  const drivers::World world(nrt.token(), s->world);
  Person p;
  p.viewers = 1;
  Clicker clicker(p, world, world.find("bin"));
  std::int64_t accept = 0;
  p.act = [&](double t) {
    if (t < 2.0 || p.picture.empty() || !clicker.click(t, 1)) return;
    if (p.once("accept", t, 0)) accept = p.say({{"act", "accept"}, {"proposal", clicker.proposal}});
  };
  static_cast<void>(desk_run::run(*s, 4, p));
  ASSERT_EQ(clicker.ious.size(), 1U);
  ASSERT_EQ(p.answers.count(accept), 1U);
  EXPECT_FALSE(p.answers[accept].ok);
  EXPECT_THAT(p.answers[accept].why, testing::HasSubstr("fusion.objects.enabled"));
}

}  // namespace
