#include "tools/report/chart_data.h"

#include <cmath>
#include <cstring>

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace faultline {
namespace {

TEST(Base64, IsThatOfTheStandard) {
  // 1.0f is 00 00 80 3F in little-endian.
  EXPECT_EQ(base64_floats({1.0F}), "AACAPw==");
  EXPECT_EQ(base64_floats({1.0F, 1.0F, 1.0F}), "AACAPwAAgD8AAIA/");
  EXPECT_EQ(base64_floats({}), "");
}

/// What a browser reads: four digits are three bytes, four bytes a float, lowest first.
std::vector<float> floats_of(const std::string& base64) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<std::uint8_t> bytes;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char digit : base64) {
    if (digit == '=') break;
    bits = (bits << 6U) | static_cast<std::uint32_t>(digits.find(digit));
    if ((count += 6) >= 8) bytes.push_back(static_cast<std::uint8_t>(bits >> (count -= 8)));
  }
  std::vector<float> values(bytes.size() / sizeof(float));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(float));
  return values;
}

Chart chart_of(const EnvelopeSeries& values) {
  Chart chart{.title = "r", .unit = {}, .summary = {}};
  chart.series.push_back({.label = "r", .sample_time_s = 0.01, .values = values});
  return chart;
}

TEST(ChartData, KeepsToItsBudgetWithoutLosingAPeak) {
  EnvelopeSeries values(0);
  for (int k = 0; k < 60'000; ++k) values.add(k, k == 12'345 ? 9.0 : std::sin(0.1 * k));
  ChartData data(100'000);
  for (int i = 0; i < 4; ++i) static_cast<void>(data.add(chart_of(values)));
  const std::string text = data.json({0.0, 600.0}, {});
  EXPECT_LT(text.size(), 101'000U + 4 * 200U);
  const auto json = nlohmann::json::parse(text);
  const auto& series = json["charts"][0]["series"][0];
  EXPECT_EQ(series["kind"], "envelope");
  const double bucket_s = series["bucket_s"];
  EXPECT_GT(bucket_s, 0.01);
  const std::vector<float> high = floats_of(series["high"]);
  const auto bucket = static_cast<std::size_t>(12'345 * 0.01 / bucket_s);
  ASSERT_LT(bucket, high.size());
  EXPECT_EQ(high[bucket], 9.0F);
  EXPECT_LT(high[bucket + 1], 1.1F);
}

TEST(ChartData, AConstantIsOneNumber) {
  EnvelopeSeries values(0);
  for (int k = 0; k < 1000; ++k) values.add(k, 0.05);
  ChartData data;
  static_cast<void>(data.add(chart_of(values)));
  const auto json = nlohmann::json::parse(data.json({0.0, 10.0}, {}));
  const auto& series = json["charts"][0]["series"][0];
  EXPECT_EQ(series["kind"], "constant");
  EXPECT_EQ(series["value"], 0.05);
}

TEST(ChartData, ALineOfFewStepsIsItsCorners) {
  EnvelopeSeries values(0);
  for (int k = 0; k < 1000; ++k) values.add(k, k < 500 ? 1.0 : 2.0);
  ChartData data;
  static_cast<void>(data.add(chart_of(values)));
  const auto json = nlohmann::json::parse(data.json({0.0, 10.0}, {}));
  EXPECT_EQ(json["charts"][0]["series"][0]["points"],
            nlohmann::json::parse("[[0.0,1.0],[5.0,1.0],[5.0,2.0],[10.0,2.0]]"));
}

TEST(Stretches, JoinsThoseThatAreNear) {
  const auto joined = stretches_s({{0, 10}, {11, 20}, {50, 60}}, 0.1, 0.5);
  ASSERT_EQ(joined.size(), 2U);
  EXPECT_DOUBLE_EQ(joined[0][1], 2.0);
  EXPECT_DOUBLE_EQ(joined[1][0], 5.0);
}

}  // namespace
}  // namespace faultline
