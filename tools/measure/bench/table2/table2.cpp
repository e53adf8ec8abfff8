#include "tools/measure/bench/table2/table2.hpp"
#include "rt/clock/box_time.hpp"
#include "rt/quantile.hpp"

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "perception/segmentation/region_grow.hpp"
#include "perception/segmentation/region_merge.hpp"
#include "tools/files/image_files.hpp"
#include "tools/files/take.hpp"

namespace teletact {
namespace {

namespace fs = std::filesystem;
using perception::Image;
using perception::LabelView;
using perception::Rgb;
using perception::ScoredMap;
using perception::SegmentationScores;

using Labels = std::vector<std::uint16_t>;

double cpu_ms() { return 1e-6 * static_cast<double>(rt::thread_cpu_ns()); }

struct Picture {
  std::string id;
  Image<Rgb> rgb;
  std::vector<Image<std::uint16_t>> maps;
  std::vector<ScoredMap> people;
  std::vector<int> regions;
};

Picture load(const fs::path& image, const fs::path& segmentations) {
  Picture p;
  p.id = image.stem().string();
  p.rgb = take(read_colour(image.string()));
  for (int k = 0;; ++k) {
    const fs::path file = segmentations / (p.id + "_" + std::to_string(k) + ".png");
    if (!fs::exists(file)) break;
    p.maps.push_back(take(read_grey(file.string())));
    if (p.maps.back().width() != p.rgb.width() || p.maps.back().height() != p.rgb.height()) {
      throw std::runtime_error(file.string() + ": is not of the image's size");
    }
    p.people.emplace_back(p.maps.back().view());
    p.regions.push_back(p.people.back().regions());
  }
  if (p.people.empty()) {
    throw std::runtime_error((segmentations / (p.id + "_0.png")).string() + ": is not there");
  }
  return p;
}

std::vector<fs::path> list_images(const fs::path& folder) {
  std::vector<fs::path> images;
  std::error_code ec;
  for (const auto& e : fs::directory_iterator(folder / "images", ec)) {
    const auto ext = e.path().extension();
    if (ext == ".jpg" || ext == ".png") images.push_back(e.path());
  }
  if (ec || images.empty()) {
    throw std::runtime_error((folder / "images").string() + ": holds no .jpg or .png image");
  }
  std::sort(images.begin(), images.end());
  return images;
}

void add(SegmentationScores& sum, const SegmentationScores& s, double weight) {
  sum.pri += weight * s.pri;
  sum.voi_bits += weight * s.voi_bits;
  sum.gce += weight * s.gce;
  sum.bde_px += weight * s.bde_px;
}

// A row under way: sums over images.
class RowSum {
 public:
  void add_image(const SegmentationScores& mean, double region_count,
                 const std::vector<int>& people, double ms) {
    add(sum_, mean, 1);
    ratio_.add(static_cast<int>(region_count + 0.5), people);
    ms_ += ms;
    ++n_;
  }
  [[nodiscard]] Table2Row row(std::string name) const {
    Table2Row r;
    r.name = std::move(name);
    if (n_ == 0) return r;
    add(r.mean, sum_, 1.0 / n_);
    r.region_ratio = ratio_.value();
    r.ms = ms_ / n_;
    return r;
  }

 private:
  SegmentationScores sum_;
  perception::RegionRatio ratio_;
  double ms_ = 0;
  int n_ = 0;
};

SegmentationScores against_people(const ScoredMap& map, const Picture& p) {
  SegmentationScores s;
  for (const auto& person : p.people) {
    add(s, compare(map, person), 1.0 / static_cast<double>(p.people.size()));
  }
  return s;
}

void score_people(const Picture& p, RowSum& row) {
  const std::size_t n = p.people.size();
  if (n < 2) return;
  SegmentationScores s;
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      add(s, compare(p.people[i], p.people[j]), 2.0 / static_cast<double>(n * (n - 1)));
    }
  }
  row.add_image(s, rt::quantile(p.regions, 0.5), p.regions, 0);
}

LabelView view_of(const Labels& labels, const Picture& p) {
  return {labels.data(), p.rgb.width(), p.rgb.height(), p.rgb.width()};
}

// One seed a region of the person's map, at the pixel deepest inside it; overlap goes to the
// smaller d, what no region reached stays one region of its own.
Labels paper_protocol(const Image<std::uint16_t>& map, const perception::LabImage& lab,
                      perception::RegionGrower& grower) {
  const int w = map.width(), h = map.height();
  std::vector<std::uint8_t> rim(static_cast<std::size_t>(w * h), 0);
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      const auto l = map.at(u, v);
      const bool inner = u > 0 && v > 0 && u < w - 1 && v < h - 1 && map.at(u - 1, v) == l &&
                         map.at(u + 1, v) == l && map.at(u, v - 1) == l && map.at(u, v + 1) == l;
      rim[static_cast<std::size_t>(v * w + u)] = inner ? 0 : 1;
    }
  }
  const auto depth = perception::squared_distance(rim, w, h);
  std::vector<int> seed(65536, -1);
  for (int i = 0; i < w * h; ++i) {
    int& s = seed[map.data()[i]];
    if (s < 0 || depth[static_cast<std::size_t>(i)] > depth[static_cast<std::size_t>(s)]) s = i;
  }
  Labels out(static_cast<std::size_t>(w * h), 0);
  std::vector<float> least(out.size(), 1e30F);
  std::uint16_t id = 0;
  for (const int s : seed) {
    if (s < 0) continue;
    ++id;
    const int n = grower.grow(lab, nullptr, s, {});
    for (int k = 0; k < n; ++k) {
      const auto i = static_cast<std::size_t>(grower.members()[static_cast<std::size_t>(k)]);
      const float d = grower.distances()[static_cast<std::size_t>(k)];
      if (d < least[i]) least[i] = d, out[i] = id;
    }
  }
  return out;
}

void score_paper(const Picture& p, RowSum& row) {
  perception::LabImage lab(p.rgb.width(), p.rgb.height());
  perception::RegionGrower grower(p.rgb.width(), p.rgb.height());
  SegmentationScores s;
  double ms = 0, regions = 0;
  const double share = 1.0 / static_cast<double>(p.people.size());
  for (std::size_t k = 0; k < p.people.size(); ++k) {
    const double t0 = cpu_ms();
    lab.set(p.rgb.view());
    const Labels labels = paper_protocol(p.maps[k], lab, grower);
    ms += share * (cpu_ms() - t0);
    const ScoredMap map(view_of(labels, p));
    regions += share * map.regions();
    add(s, compare(map, p.people[k]), share);
  }
  row.add_image(s, regions, p.regions, ms);
}

// Pieces of an image: a label a pixel, from 1 on, and of each its pixels and mean colour.
struct Pieces {
  Labels labels;
  std::vector<double> pixels{0};
  std::vector<cv::Vec3d> mean{cv::Vec3d()};
};

Pieces pieces_of_like_colour(const cv::Mat& image) {
  const int w = image.cols, h = image.rows;
  cv::Mat filled = image, mask(h + 2, w + 2, CV_8U, cv::Scalar(0));
  Pieces out{Labels(static_cast<std::size_t>(w * h), 0)};
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      if (mask.at<std::uint8_t>(v + 1, u + 1) != 0) continue;
      cv::Rect box;
      cv::floodFill(filled, mask, {u, v}, {}, &box, cv::Scalar::all(3), cv::Scalar::all(3),
                    4 | cv::FLOODFILL_MASK_ONLY | (2 << 8));
      const auto id = static_cast<std::uint16_t>(std::min<std::size_t>(out.pixels.size(), 65535));
      cv::Vec3d sum(0, 0, 0);
      double n = 0;
      for (int y = box.y; y < box.y + box.height; ++y) {
        for (int x = box.x; x < box.x + box.width; ++x) {
          std::uint8_t& m = mask.at<std::uint8_t>(y + 1, x + 1);
          if (m != 2) continue;
          m = 1;
          out.labels[static_cast<std::size_t>(y * w + x)] = id;
          const auto c = image.at<cv::Vec3b>(y, x);
          sum += cv::Vec3d(c[0], c[1], c[2]);
          n += 1;
        }
      }
      out.pixels.push_back(n);
      out.mean.push_back(sum / n);
    }
  }
  return out;
}

using Neighbours = std::vector<std::vector<int>>;  // of each piece, without doubles
Neighbours neighbours_of(const Pieces& p, int w, int h) {
  Neighbours near(p.pixels.size());
  for (int i = 0; i < w * h; ++i) {
    for (const int j : {i % w + 1 < w ? i + 1 : i, i + w < w * h ? i + w : i}) {
      const auto a = p.labels[static_cast<std::size_t>(i)],
                 b = p.labels[static_cast<std::size_t>(j)];
      if (a != b) near[a].push_back(b), near[b].push_back(a);
    }
  }
  for (auto& list : near) {
    std::sort(list.begin(), list.end());
    list.erase(std::unique(list.begin(), list.end()), list.end());
  }
  return near;
}

// Pieces below 600 pixels, the smallest first, to the neighbour of the most alike mean.
Labels joined(Pieces p, Neighbours near) {
  constexpr double kLeastPixels = 600;
  std::vector<int> parent(p.pixels.size());
  for (std::size_t i = 0; i < parent.size(); ++i) parent[i] = static_cast<int>(i);
  const auto root = [&](int i) {
    while (parent[static_cast<std::size_t>(i)] != i) i = parent[static_cast<std::size_t>(i)];
    return i;
  };
  std::vector<int> order(parent.begin() + 1, parent.end());
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return p.pixels[static_cast<std::size_t>(a)] != p.pixels[static_cast<std::size_t>(b)]
               ? p.pixels[static_cast<std::size_t>(a)] < p.pixels[static_cast<std::size_t>(b)]
               : a < b;
  });
  for (const int first : order) {
    const int i = root(first);
    const auto a = static_cast<std::size_t>(i);
    if (i != first || p.pixels[a] >= kLeastPixels) continue;
    int best = -1;
    double least = 0;
    for (const int other : near[a]) {
      const int j = root(other);
      if (j == i) continue;
      const double d = cv::norm(p.mean[a] - p.mean[static_cast<std::size_t>(j)]);
      if (best < 0 || d < least) best = j, least = d;
    }
    if (best < 0) continue;
    const auto b = static_cast<std::size_t>(best);
    p.mean[b] = (p.mean[b] * p.pixels[b] + p.mean[a] * p.pixels[a]) / (p.pixels[a] + p.pixels[b]);
    p.pixels[b] += p.pixels[a];
    parent[a] = best;
    near[b].insert(near[b].end(), near[a].begin(), near[a].end());
  }
  for (auto& l : p.labels) l = static_cast<std::uint16_t>(root(l));
  return p.labels;
}

// OpenCV's mean shift filter, then pieces of like colour, joined.
Labels mean_shift(const Image<Rgb>& rgb) {
  const int w = rgb.width(), h = rgb.height();
  cv::Mat image(h, w, CV_8UC3), filtered;
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      const Rgb c = rgb.at(u, v);
      image.at<cv::Vec3b>(v, u) = {c.b, c.g, c.r};
    }
  }
  cv::pyrMeanShiftFiltering(image, filtered, 12, 20, 1);
  Pieces pieces = pieces_of_like_colour(filtered);
  Neighbours near = neighbours_of(pieces, w, h);
  return joined(std::move(pieces), std::move(near));
}

void print_row(std::ostream& out, const char* name, double pri, double bde, double gce, double voi,
               double ratio, double ms) {
  char line[160], more[80] = "";
  if (voi >= 0) std::snprintf(more, sizeof more, "%8.3f %8.2f", voi, ratio);
  std::snprintf(line, sizeof line, "%-26s %8.4f %8.3f %8.4f %17s", name, pri, bde, gce, more);
  out << line;
  if (ms > 0) {
    std::snprintf(line, sizeof line, " %8.1f", ms);
    out << line;
  }
  out << '\n';
}

}  // namespace

Table2Result bench_table2(std::ostream& progress, const std::string& folder, bool ours_only,
                          const perception::WholeImageConfig& config) {
  cv::setNumThreads(1);
  Table2Result result;
  RowSum people, ours, odd, even, paper, shift;
  for (const fs::path& image : list_images(folder)) {
    const Picture p = load(image, fs::path(folder) / "segmentations");
    progress << "\r" << p.id << "   " << std::flush;
    if (!ours_only) score_people(p, people);
    double t0 = cpu_ms();
    const auto whole = perception::segment_whole(p.rgb.view(), config);
    double ms = cpu_ms() - t0;
    auto s = against_people(ScoredMap(view_of(whole.labels, p)), p);
    ours.add_image(s, whole.regions, p.regions, ms);
    (result.images % 2 != 0 ? even : odd).add_image(s, whole.regions, p.regions, ms);
    ++result.images;
    result.maps += static_cast<int>(p.people.size());
    if (ours_only) continue;
    score_paper(p, paper);
    t0 = cpu_ms();
    const Labels peer = mean_shift(p.rgb);
    ms = cpu_ms() - t0;
    const ScoredMap peer_map(view_of(peer, p));
    shift.add_image(against_people(peer_map, p), peer_map.regions(), p.regions, ms);
  }
  progress << "\r                \r";
  result.people = people.row("people");
  result.ours = ours.row("teletact");
  result.odd = odd.row("  1st, 3rd, ... image");
  result.even = even.row("  2nd, 4th, ... image");
  result.paper_protocol = paper.row("paper's protocol");
  result.mean_shift = shift.row("mean shift (OpenCV)");
  return result;
}

std::vector<Limit> Table2Result::limits() const {
  const std::string why_not = images > 0 ? "" : "no images";
  Limits all;
  all.add("PRI", ours.mean.pri, ">=", 0.80, why_not);
  all.add("BDE, px", ours.mean.bde_px, "<=", 12.5, why_not);
  all.add("GCE", ours.mean.gce, "<=", 0.22, why_not);
  all.add("VOI, bit", ours.mean.voi_bits, "<=", 2.2, why_not);
  all.add("regions to people's", ours.region_ratio, ">=", 0.5, why_not);
  all.add("regions to people's", ours.region_ratio, "<=", 2.0, why_not);
  return all.all();
}

std::vector<BenchMetric> Table2Result::metrics() const {
  std::vector<BenchMetric> m;
  const auto put = [&](const std::string& head, const Table2Row& r) {
    m.push_back({head + "pri", r.mean.pri, "1"});
    m.push_back({head + "bde", r.mean.bde_px, "px"});
    m.push_back({head + "gce", r.mean.gce, "1"});
    m.push_back({head + "voi", r.mean.voi_bits, "bit"});
    m.push_back({head + "region_ratio", r.region_ratio, "1"});
    if (r.ms > 0) m.push_back({head + "ms", r.ms, "ms"});
  };
  m.push_back({"table2.images", static_cast<double>(images), "1"});
  put("table2.", ours);
  put("table2.people.", people);
  put("table2.paper_protocol.", paper_protocol);
  put("table2.mean_shift.", mean_shift);
  return m;
}

void Table2Result::print(std::ostream& out) const {
  out << images << " images, " << maps << " label maps of people. PRI up, others down; regions: "
      << "ours / median of the people;\nms: thread CPU an image.\n\n";
  char head[160];
  std::snprintf(head, sizeof head, "%-26s %8s %8s %8s %8s %8s %8s\n", "", "PRI", "BDE px", "GCE",
                "VOI bit", "regions", "ms");
  out << head;
  for (const Table2Row* r : {&people, &ours, &odd, &even, &paper_protocol, &mean_shift}) {
    print_row(out, r->name.c_str(), r->mean.pri, r->mean.bde_px, r->mean.gce, r->mean.voi_bits,
              r->region_ratio, r->ms);
  }
  out << "published (other images of BSDS):\n";
  print_row(out, "  Ncut", .7393, 17.156, .2232, -1, 0, 0);
  print_row(out, "  CTM", .7796, 19.198, .3647, -1, 0, 0);
  print_row(out, "  mean shift", .7769, 13.162, .5811, -1, 0, 0);
  print_row(out, "  the paper", .73876, 14.216, .5432, -1, 0, 0);
  teletact::print(out, limits());
}

}  // namespace teletact
