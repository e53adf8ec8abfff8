// teletact segment: the object under a touch, or every region of an image.
//
//   --color C.png             8 bit colour
//   --depth D.png             16 bit, registered to the colour, --depth-unit mm a step; 0 and 65535
//                             are no reading; needs --intrinsics
//   --touch x,y               pixel; the k-th touch paints value k. A pixel that several objects
//                             claim goes to the one it is nearer to (d of the paper), then to the
//                             first
//   --not x,y                 pixel that is not of the object; then, or with --one-object, all
//                             touches and nots name one object, painted with value 1; needs --depth
//   --whole                   every region of the image, with depth or by colour alone
//   --method default|paper    paper: region growing from the touched pixel, nothing else; d = |dI| + m/g |dP|,
//                             --m, --g (mm with depth, else px), --threshold
//   --out MASK.png            8 bit, 0 = no object; with --whole labels 1..N, 16 bit when N > 255
//
// Without depth `default` is the region of the whole-image segmentation under the touch. The
// touched pixel always carries its touch's value unless a later touch names the same pixel.
#include <CLI/CLI.hpp>
#include <stdexcept>
#include <string>

#include "tools/cli/options.hpp"
#include "tools/offline/segment.hpp"
#include "tools/teletact/commands.hpp"

namespace teletact {
namespace {

void check(const SegmentOptions& o) {
  if (o.whole == !o.touches.empty()) {
    throw std::runtime_error("give either --whole or at least one --touch");
  }
  if (o.whole && o.method != "default") {
    throw std::runtime_error("--method can not be used with --whole: it belongs to touches");
  }
  const bool one = o.one_object || !o.nots.empty();
  if (one && o.touches.empty())
    throw std::runtime_error("--not and --one-object need at least one --touch");
  if (one && o.method != "default")
    throw std::runtime_error("--not and --one-object have no meaning with --method " + o.method);
  if (one && o.depth.empty()) throw std::runtime_error("--not and --one-object need --depth");
  if (o.touches.size() > 255)
    throw std::runtime_error("--touch: " + std::to_string(o.touches.size()) +
                             " given, at most 255");
}

// What would be passed over in silence. --m and --g part what several touches claim, whatever the
// method.
void check_meant(const CLI::App& app, const SegmentOptions& o) {
  for (const char* option : {"--m", "--g", "--threshold"}) {
    if (o.whole && app.count(option) > 0) {
      throw std::runtime_error(std::string(option) + " has no meaning with --whole");
    }
  }
  if (app.count("--threshold") > 0 && o.method != "paper") {
    throw std::runtime_error("--threshold has no meaning with --method " + o.method +
                             ": it belongs to --method paper");
  }
  if (app.count("--depth-unit") > 0 && o.depth.empty()) {
    throw std::runtime_error("--depth-unit has no meaning without --depth");
  }
}

}  // namespace

int cmd_segment(int argc, char** argv) {
  SegmentOptions o;
  float g = 0;
  CLI::App app("teletact segment: the object under a touch, or every region of an image",
               "teletact segment");
  app.add_option("--color", o.color, "colour image, PNG or JPEG")->required();
  auto* depth = app.add_option("--depth", o.depth, "registered depth, 16 bit PNG");
  app.add_option("--depth-unit", o.depth_unit_mm, "mm a step of the depth image")
      ->check(in_range(0.001, 100))
      ->capture_default_str();
  depth->needs(app.add_option("--intrinsics", o.intrinsics, "fx,fy,cx,cy in px")->needs(depth));
  app.add_option("--touch", o.touches, "pixel x,y; repeat for more objects");
  app.add_option("--not", o.nots,
                 "pixel x,y that is not of the object; all touches name one object; needs --depth");
  app.add_flag("--one-object", o.one_object, "all touches name one object; needs --depth");
  app.add_flag("--whole", o.whole, "segment the whole image");
  app.add_option("--method", o.method, "default | paper")
      ->check(CLI::IsMember({"default", "paper"}))
      ->capture_default_str();
  app.add_option("--m", o.grow.m, "paper: weight of place against colour")
      ->check(in_range(1, 20))
      ->capture_default_str();
  app.add_option("--g", g, "paper: distance that counts as m Lab units, mm with depth, else px")
      ->check(in_range(0.1, 10000));
  app.add_option("--threshold", o.grow.threshold, "paper: largest d that joins")
      ->check(in_range(0, 1000));
  app.add_option("--out", o.out, "PNG to write")->required();
  app.add_option("--json", o.json, "figures to write: each object's pose, extent, colour");
  if (!parse_options(app, argc, argv)) return 0;
  check_meant(app, o);
  if (app.count("--threshold") > 0) o.grow.threshold_flat = o.grow.threshold;
  if (g > 0) o.grow.g_mm = o.grow.g_px = g;
  check(o);
  segment_image(o);
  return 0;
}

}  // namespace teletact
