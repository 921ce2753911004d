#include "tools/dashboard/viewer_request.h"

#include <cmath>
#include <random>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using testing::HasSubstr;

/// What is said against a message; empty: nothing.
std::string refusal(const std::string& text) {
  try {
    static_cast<void>(parse_viewer_request(text));
  } catch (const ViewerRequestError& error) {
    return error.what();
  }
  return {};
}

TEST(ViewerRequest, InjectsAFault) {
  const inject_t request =
      parse_viewer_request(R"({"type": "inject", "target": "u2", "kind": "bias", "value": -2.5})");
  EXPECT_EQ(request.clear, 0);
  EXPECT_EQ(request.target, "u2");
  EXPECT_EQ(request.kind, "bias");
  EXPECT_EQ(request.has_value, 1);
  EXPECT_EQ(request.value, -2.5);
  EXPECT_EQ(request.probability, 1.0);
  EXPECT_EQ(request.duration_s, 0.0);
}

TEST(ViewerRequest, NeedsNoValue) {
  const inject_t request =
      parse_viewer_request(R"({"type": "inject", "target": "Sensors1", "kind": "dropped"})");
  EXPECT_EQ(request.has_value, 0);
}

TEST(ViewerRequest, ClearsOneTargetOrAll) {
  EXPECT_EQ(parse_viewer_request(R"({"type": "clear"})").target, "");
  const inject_t request = parse_viewer_request(R"({"type": "clear", "target": "u2"})");
  EXPECT_EQ(request.clear, 1);
  EXPECT_EQ(request.target, "u2");
}

TEST(ViewerRequest, RefusesEverythingElseWithTheReason) {
  const std::string long_name(257, 'x');
  const struct {
    std::string text, reason;
  } cases[] = {
      {"", "found no JSON"},
      {"{", "found no JSON"},
      {"{}x", "found no JSON"},
      {std::string(4000, '['), "found no JSON"},
      {std::string("{\"type\": \"clear\"}\0", 18), "found no JSON"},
      {"\xef\xbb\xbf{\"type\": 1}", "type: found number"},
      {"\"clear\"", "expected an object"},
      {"null", "expected an object"},
      {"[{\"type\": \"clear\"}]", "expected an object"},
      {"{}", "found no type"},
      {R"({"type": null})", "type: found null"},
      {R"({"type": ""})", "type: found 0 bytes"},
      {R"({"type": "CLEAR"})", "expected inject or clear"},
      {R"({"type": "sent"})", "expected inject or clear"},
      {R"({"type": "clear", "value": 1})", "none of: type, target"},
      {R"({"type": "clear", "target": 3})", "target: found number"},
      {R"({"type": "inject"})", "found no target"},
      {R"({"type": "inject", "target": "u2"})", "found no kind"},
      {R"({"type": "inject", "target": "", "kind": "bias"})", "target: found 0 bytes"},
      {R"({"type": "inject", "target": "u2", "kind": ["bias"]})", "kind: found array"},
      {R"({"type": "inject", "target": "u\n2", "kind": "bias"})", "control characters"},
      {R"({"type": "inject", "target": "u\u0000", "kind": "bias"})", "control characters"},
      {R"({"type": "inject", "target": "u\u007f", "kind": "bias"})", "control characters"},
      {R"({"type": "inject", "target": ")" + long_name + R"(", "kind": "bias"})", "257 bytes"},
      {R"({"type": "inject", "target": "u2", "kind": "bias", "value": "2"})", "finite number"},
      {R"({"type": "inject", "target": "u2", "kind": "bias", "value": null})", "finite number"},
      {R"({"type": "inject", "target": "u2", "kind": "bias", "value": true})", "finite number"},
      {R"({"type": "inject", "target": "u2", "kind": "bias", "value": 1e999})", "expected"},
      {R"({"type": "inject", "target": "u2", "kind": "bias", "value": NaN})", "found no JSON"},
      {R"({"type": "inject", "target": "u2", "kind": "bias", "duration_s": 1})", "none of"},
      {R"({"type": "inject", "target": "u2", "kind": "bias", "request": "x"})", "none of"},
      {std::string(kLongestRequest + 1, ' '), "found 4097 bytes"},
  };
  for (const auto& one : cases) {
    EXPECT_THAT(refusal(one.text), HasSubstr(one.reason)) << one.text;
  }
}

TEST(ViewerRequest, TakesALongestMessage) {
  std::string text = R"({"type": "clear"})";
  text.resize(kLongestRequest, ' ');
  EXPECT_EQ(refusal(text), "");
}

TEST(ViewerRequest, RandomMessagesAreRefusedOrWithinBounds) {
  const std::uint64_t seed = test_seed(20261127);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  const std::string models[] = {
      R"({"type": "inject", "target": "u2", "kind": "bias", "value": 2.5e0})",
      R"({"type": "clear", "target": "\u0075\t2"})", R"({"type": "clear"})"};
  int taken = 0, refused = 0;
  for (int i = 0; i < 100'000; ++i) {
    std::string text = models[draw() % std::size(models)];
    for (std::uint64_t n = draw() % 4; n > 0; --n) {
      const std::size_t at = draw() % text.size();
      if (draw() % 2 == 0) {
        text[at] = static_cast<char>(draw());
      } else {
        text.insert(at, 1 + draw() % 3, "\"{}[]:,\\0e9u"[draw() % 12]);
      }
    }
    try {
      const inject_t request = parse_viewer_request(text);
      ++taken;
      ASSERT_TRUE(request.clear != 0 || (!request.target.empty() && !request.kind.empty())) << text;
      ASSERT_TRUE(std::isfinite(request.value)) << text;
      ASSERT_LE(request.target.size(), 256u);
      for (const char letter : request.target + request.kind) {
        ASSERT_GE(static_cast<unsigned char>(letter), 0x20) << text;
      }
    } catch (const ViewerRequestError& error) {
      ++refused;
      ASSERT_STRNE(error.what(), "");
    }
  }
  EXPECT_GT(taken, 1000);
  EXPECT_GT(refused, 1000);
}

}  // namespace
}  // namespace faultline
