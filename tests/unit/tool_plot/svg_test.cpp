#include "tools/report/svg.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "rt/random.hpp"
#include "tests/support/xml_check.hpp"
#include "tools/report/canvas.hpp"

namespace {

using support::xml_problem;
using testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInf = std::numeric_limits<double>::infinity();

std::vector<std::uint8_t> bytes(const std::string& s) { return {s.begin(), s.end()}; }

std::vector<std::uint8_t> unbase64(const std::string& s) {
  static const std::string digits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<std::uint8_t> out;
  std::uint32_t w = 0;
  int bits = 0;
  for (const char c : s) {
    if (c == '=') break;
    w = w << 6U | static_cast<std::uint32_t>(digits.find(c));
    bits += 6;
    if (bits >= 8)
      bits -= 8, out.push_back(static_cast<std::uint8_t>(w >> static_cast<unsigned>(bits)));
  }
  return out;
}

TEST(XmlCheck, FindsWhatIsWrong) {
  EXPECT_EQ(xml_problem("<a b=\"c\"><d/>t &amp; u</a>"), "");
  for (const char* bad : {"<a>", "</a>", "<a></b>", "<a b=\"c></a>", "x & y", "a > b", "1 < 2"}) {
    EXPECT_NE(xml_problem(bad), "") << bad;
  }
}

TEST(Base64, Rfc4648Vectors) {
  EXPECT_EQ(plot::base64(bytes("")), "");
  EXPECT_EQ(plot::base64(bytes("f")), "Zg==");
  EXPECT_EQ(plot::base64(bytes("fo")), "Zm8=");
  EXPECT_EQ(plot::base64(bytes("foo")), "Zm9v");
  EXPECT_EQ(plot::base64(bytes("foobar")), "Zm9vYmFy");
  rt::Random r(3);
  for (int i = 0; i < 100; ++i) {
    std::vector<std::uint8_t> v(static_cast<std::size_t>(r.integer(0, 50)));
    for (auto& b : v) b = static_cast<std::uint8_t>(r());
    EXPECT_EQ(unbase64(plot::base64(v)), v);
  }
}

TEST(Ticks, RoundNumbersInsideTheRange) {
  EXPECT_THAT(plot::nice_ticks(0, 10, 5), testing::ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(plot::nice_ticks(-1, 1, 4),
              testing::Pointwise(testing::DoubleNear(1e-12), {-1.0, -0.5, 0.0, 0.5, 1.0}));
  rt::Random r(4);
  for (int i = 0; i < 2000; ++i) {
    const double lo = r.normal() * std::pow(10, r.uniform(-9, 9));
    const double hi = lo + std::abs(r.normal()) * std::pow(10, r.uniform(-6, 9)) + 1e-9;
    const int wanted = static_cast<int>(r.integer(2, 12));
    const auto t = plot::nice_ticks(lo, hi, wanted);
    EXPECT_LE(t.size(), static_cast<std::size_t>(2 * wanted + 2));
    for (const double v : t) {
      EXPECT_GE(v, lo - (hi - lo) * 1e-6);
      EXPECT_LE(v, hi + (hi - lo) * 1e-6);
    }
  }
  EXPECT_TRUE(plot::nice_ticks(1, 1, 5).empty());
  EXPECT_TRUE(plot::nice_ticks(0, kNan, 5).empty());
  EXPECT_TRUE(plot::nice_ticks(0, kInf, 5).empty());
}

// 1, 2 and 5 alone would leave less than a decade bare.
TEST(Ticks, ALogarithmicAxisIsNeverBare) {
  rt::Random r(5);
  for (int i = 0; i < 500; ++i) {
    const double lo = std::pow(10, r.uniform(-6, 6));
    const double hi = lo * std::pow(10, r.uniform(0.02, 2));
    const auto t = plot::Scale::over(lo, hi, true).ticks(5);
    EXPECT_GE(t.size(), 2U) << lo << " to " << hi;
    for (const double v : t) {
      EXPECT_GE(v, lo * 0.99999);
      EXPECT_LE(v, hi * 1.00001);
    }
  }
}

TEST(Number, IsShort) {
  EXPECT_EQ(plot::number(0), "0");
  EXPECT_EQ(plot::number(-0.0), "0");
  EXPECT_EQ(plot::number(0.25), "0.25");
  EXPECT_EQ(plot::number(20000), "20000");
  EXPECT_EQ(plot::number(1e6), "1e6");
  EXPECT_EQ(plot::number(1e-7), "1e-7");
  EXPECT_EQ(plot::number(kNan), "-");
}

TEST(LinePlot, MarksOfOnePlaceStandApart) {
  plot::Figure f;
  f.log_x = f.log_y = true;
  f.marks = {{1, 1, "first", true},
             {1, 1, "second", false},
             {10, 10, "third", false},
             {-1, 1, "nowhere", false},
             {1, kNan, "nothing", false}};
  const std::string svg = plot::line_plot(f);
  EXPECT_EQ(xml_problem(svg), "");
  std::set<std::string> heights;
  for (const char* label : {">first<", ">second<"}) {
    const auto at = svg.find(label);
    ASSERT_NE(at, std::string::npos) << label;
    const auto y = svg.rfind(" y=\"", at);
    heights.insert(svg.substr(y, svg.find('"', y + 4) - y));
  }
  EXPECT_EQ(heights.size(), 2U) << "one above the other";
  EXPECT_EQ(svg.find("nowhere"), std::string::npos) << "not on a logarithmic axis";
  EXPECT_EQ(svg.find("nothing"), std::string::npos);
}

TEST(LinePlot, ThinningKeepsThePeak) {
  plot::Figure f;
  f.title = "a < b & \"c\"";
  plot::Series s;
  s.name = "force";
  for (int i = 0; i < 200000; ++i) {
    s.x.push_back(i * 1e-3);
    s.y.push_back(i == 123456 ? 9.0 : std::sin(i * 0.01));
  }
  f.series = {s};
  const std::string svg = plot::line_plot(f);
  EXPECT_EQ(xml_problem(svg), "");
  EXPECT_LT(svg.size(), 80000U) << "a figure, not a data file";
  EXPECT_THAT(svg, HasSubstr("a &lt; b &amp; &quot;c&quot;"));
  // The peak is the highest point: its y must appear, far above every other point.
  const auto begin = svg.find("<polyline points=\"") + 18;
  double top = 1e9, second = 1e9;
  for (const char *p = svg.c_str() + begin, *end = svg.c_str() + svg.find('"', begin); p < end;) {
    char* next = nullptr;
    std::strtod(p, &next);
    const double y = std::strtod(next + 1, &next);
    if (y < top)
      second = top, top = y;
    else
      second = std::min(second, y);
    p = next;
    while (*p == ' ') ++p;
  }
  EXPECT_GT(second - top, 50);
}

TEST(LinePlot, SurvivesEverything) {
  plot::Figure f;
  EXPECT_EQ(xml_problem(plot::line_plot(f)), "");
  EXPECT_THAT(plot::line_plot(f), HasSubstr("no data"));
  rt::Random r(5);
  const double odd[] = {0, -1, 1, kNan, kInf, -kInf, 1e300, -1e300, 1e-300, 5};
  for (int i = 0; i < 500; ++i) {
    plot::Figure g;
    g.log_x = r.uniform() < 0.5;
    g.log_y = r.uniform() < 0.5;
    for (int k = 0; k < 2; ++k) {
      plot::Series s;
      s.name = k == 0 ? "one" : "";
      s.points = r.uniform() < 0.3;
      s.filled = r.uniform() < 0.3;
      for (auto n = r.integer(0, 8); n > 0; --n) {
        s.x.push_back(odd[r.integer(0, 9)]);
        s.y.push_back(odd[r.integer(0, 9)]);
      }
      if (!s.y.empty() && r.uniform() < 0.2) s.y.pop_back();
      g.series.push_back(s);
    }
    g.rules = {{odd[r.integer(0, 9)], r.uniform() < 0.5, "limit", "red"}};
    const std::string svg = plot::line_plot(g);
    ASSERT_EQ(xml_problem(svg), "") << i;
    ASSERT_EQ(svg.find("nan"), std::string::npos) << i;
    ASSERT_EQ(svg.find("inf"), std::string::npos) << i;
    plot::Bins b{"h", g.series[0].x, g.series[0].y, 0, ""};
    const std::string h = plot::histogram(g, std::span<const plot::Bins>(&b, 1));
    ASSERT_EQ(xml_problem(h), "") << i;
    ASSERT_EQ(h.find("nan"), std::string::npos) << i << h;
  }
}

TEST(Histogram, ACountOfOneIsSeen) {
  plot::Figure f;
  f.log_x = f.log_y = true;
  const plot::Bins b{"CPU", {1, 2, 4, 8}, {100000, 10, 0, 1}, 16, "#123456"};
  const std::string svg = plot::histogram(f, std::span<const plot::Bins>(&b, 1));
  EXPECT_EQ(xml_problem(svg), "");
  EXPECT_THAT(svg, HasSubstr("#123456"));
  const auto begin = svg.find("<polygon points=\"") + 17;
  const std::string points = svg.substr(begin, svg.find('"', begin) - begin);
  // Base, then two corners a bin, then base: the last bin's corners lie above the base.
  std::vector<double> ys;
  for (std::size_t i = 0; (i = points.find(',', i)) != std::string::npos; ++i) {
    ys.push_back(std::strtod(points.c_str() + i + 1, nullptr));
  }
  ASSERT_EQ(ys.size(), 10U);
  EXPECT_EQ(ys.front(), ys.back());
  EXPECT_EQ(ys[5], ys.front()) << "an empty bin lies on the base";
  EXPECT_LT(ys[7], ys.front() - 3) << "one job in a hundred thousand is visible";
  EXPECT_LT(ys[1], ys[3]);
}

plot::Picture gradient(int w, int h, int channels) {
  plot::Picture p;
  p.width = w, p.height = h, p.channels = channels;
  for (int v = 0; v < h; ++v) {
    for (int u = 0; u < w; ++u) {
      for (int c = 0; c < channels; ++c) {
        p.pixels.push_back(static_cast<std::uint8_t>(10 * u + 40 * v + 80 * c));
      }
    }
  }
  return p;
}

TEST(Picture, PngHoldsThePixels) {
  for (const int channels : {1, 3}) {
    const auto p = gradient(7, 5, channels);
    const std::string url = plot::png_data_url(p);
    ASSERT_EQ(url.rfind("data:image/png;base64,", 0), 0U);
    const auto png = unbase64(url.substr(22));
    const cv::Mat m = cv::imdecode(png, cv::IMREAD_UNCHANGED);
    ASSERT_EQ(m.cols, 7);
    ASSERT_EQ(m.rows, 5);
    for (int v = 0; v < 5; ++v) {
      for (int u = 0; u < 7; ++u) {
        for (int c = 0; c < channels; ++c) {
          const int i = (v * 7 + u) * channels + c;
          const int stored =
              channels == 1 ? m.at<std::uint8_t>(v, u) : m.at<cv::Vec3b>(v, u)[2 - c];
          EXPECT_EQ(stored, p.pixels[static_cast<std::size_t>(i)]);
        }
      }
    }
  }
}

TEST(Picture, RefusesAWrongSize) {
  auto p = gradient(7, 5, 3);
  p.pixels.pop_back();
  EXPECT_THROW((void)plot::png_data_url(p), std::runtime_error);
  EXPECT_THROW((void)plot::image_plot("", plot::Picture{}, {}), std::runtime_error);
  p.channels = 2;
  EXPECT_THROW((void)plot::png_data_url(p), std::runtime_error);
}

TEST(Picture, OverlaysOfEveryKind) {
  using Kind = plot::Overlay::Kind;
  std::vector<plot::Overlay> o;
  for (const Kind k : {Kind::kPolyline, Kind::kCross, Kind::kDot, Kind::kCircle, Kind::kArrow}) {
    o.push_back({k, {1, 2, kNan, 4, 5}, {1, 3, 1, 2, kInf}, "#abc", "label <&>", 2, 5, true});
    o.push_back({k, {}, {}, "#abc", "nothing", 2, 5, false});
    o.push_back({k, {1}, {1}, "#abc", "", 2, 5, false});
  }
  for (const auto& svg : {plot::image_plot("t", gradient(7, 5, 3), o, 300),
                          plot::map_plot({"t", -1, -2, 0.05, 400}, gradient(7, 50, 3), o)}) {
    EXPECT_EQ(xml_problem(svg), "");
    EXPECT_EQ(svg.find("nan"), std::string::npos);
    EXPECT_EQ(svg.find("nothing"), std::string::npos) << "no legend entry for nothing";
  }
}

TEST(Map, YPointsUp) {
  // A single white cell at the upper right of the map, and a cross on it in metres.
  plot::Picture p{10, 10, 1, std::vector<std::uint8_t>(100, 0)};
  p.pixels[9 * 10 + 9] = 255;  // row 9: the largest y
  const plot::Overlay o{plot::Overlay::Kind::kDot, {0.475}, {0.475}, "#f00", "", 2, 5, false};
  const std::string svg =
      plot::map_plot({"", 0, 0, 0.05, 400}, p, std::span<const plot::Overlay>(&o, 1));
  const auto url = svg.find("base64,") + 7;
  const auto png = unbase64(svg.substr(url, svg.find('"', url) - url));
  const cv::Mat m = cv::imdecode(png, cv::IMREAD_UNCHANGED);
  EXPECT_EQ(m.at<std::uint8_t>(0, 9), 255);
  const auto cy = svg.find("cy=\"");
  EXPECT_LT(std::strtod(svg.c_str() + cy + 4, nullptr), 120) << "near the top";
}

}  // namespace
