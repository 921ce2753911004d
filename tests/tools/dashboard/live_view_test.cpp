#include "tools/dashboard/live_view.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include <faultline/run_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/digest.h"
#include "tests/support/random_seed.h"
#include "tools/bench/bench_inputs.h"
#include "tools/dashboard/terminal_picture.h"
#include "tools/dashboard/view_json.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const std::filesystem::path kExample = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015";
constexpr std::size_t kChunk = 60000;

template <class Message>
std::vector<std::uint8_t> encoded(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

std::string dbc_text() {
  std::ifstream file(kExample / "bench.dbc");
  return {std::istreambuf_iterator<char>(file), {}};
}

/// The example's bank as the bench sends it.
const std::string& example_bank() {
  static const std::string text = bank_text(load_bench_inputs(kExample / "nodes.toml").bank);
  return text;
}

class LiveViewTest : public testing::Test {
 protected:
  template <class Message>
  void take(const char* channel, const Message& message) {
    take_bytes(channel, encoded(message));
  }
  void take_bytes(const char* channel, const std::vector<std::uint8_t>& bytes) {
    view_.take({.channel = channel, .utime = 0, .data = bytes});
  }
  static run_t chunk(const std::string& run, const std::string& part, const std::string& digest,
                     std::int32_t number, std::int32_t count, const std::string& text) {
    run_t result{};
    result.run_id = run;
    result.part = part;
    result.name = part + ".file";
    result.digest = digest;
    result.chunk = number;
    result.chunk_count = count;
    result.byte_count = static_cast<std::int32_t>(text.size());
    result.data.assign(text.begin(), text.end());
    return result;
  }
  /// A part in as many chunks as it takes; without the first `from` of them.
  void send_part(const std::string& run, const std::string& part, const std::string& text,
                 std::size_t size = kChunk, std::size_t from = 0) {
    const std::size_t count = (text.size() + size - 1) / size;
    for (std::size_t i = from; i < count; ++i) {
      take(kRunChannel, chunk(run, part, text_digest(text), static_cast<std::int32_t>(i),
                              static_cast<std::int32_t>(count), text.substr(i * size, size)));
    }
  }
  void send_residual(std::int64_t sequence, std::vector<double> evaluation) {
    residual_t residual{};
    residual.sequence = residual.cycle = sequence;
    residual.filter_count = static_cast<std::int32_t>(evaluation.size());
    residual.threshold.assign(evaluation.size(), 0.5);
    for (const double value : evaluation) residual.fired.push_back(value > 0.5 ? 1 : 0);
    residual.evaluation = std::move(evaluation);
    take(kResidualChannel, residual);
  }

  LiveView view_;
};

TEST_F(LiveViewTest, KnowsARunFromItsDbcAndItsBank) {
  send_part("a", "scenario", "schema = 1");
  EXPECT_EQ(view_.run_id(), "a");
  EXPECT_FALSE(view_.bank());
  EXPECT_EQ(view_.filter_name(0), "residual 1");
  const std::uint64_t revision = view_.run_revision();
  send_part("a", "dbc", dbc_text());
  EXPECT_FALSE(view_.dbc().messages.empty());
  send_part("a", "bank", example_bank(), 1000);
  ASSERT_TRUE(view_.bank());
  EXPECT_EQ(view_.filter_name(0), "r12");
  EXPECT_GT(view_.run_revision(), revision);
  EXPECT_EQ(view_.unreadable(), 0u);
}

TEST_F(LiveViewTest, ChunksMayComeInAnyOrderAndTwice) {
  std::vector<run_t> chunks;
  const std::string& text = example_bank();
  constexpr std::size_t kSize = 997;
  const auto count = static_cast<std::int32_t>((text.size() + kSize - 1) / kSize);
  for (std::int32_t i = 0; i < count; ++i) {
    chunks.push_back(chunk("a", "bank", text_digest(text), i, count,
                           text.substr(static_cast<std::size_t>(i) * kSize, kSize)));
  }
  const std::vector<run_t> again = chunks;
  chunks.insert(chunks.end(), again.begin(), again.end());
  const std::uint64_t seed = test_seed(20261123);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  std::shuffle(chunks.begin(), chunks.end(), draw);
  for (const run_t& one : chunks) take(kRunChannel, one);
  EXPECT_TRUE(view_.bank());
}

TEST_F(LiveViewTest, RepeatedChunksUseNothingUp) {
  // Twice the allowance of each kind of what says nothing new or nothing that is looked at.
  const std::string text(kChunk, 'x');
  const std::size_t times = 2 * LiveView::kRunBytes / kChunk;
  for (std::size_t i = 0; i < times; ++i) {
    take(kRunChannel, chunk("a", "bank", "some digest", 0, 9, text));
    take(kRunChannel, chunk("a", "bank", "some digest", 9, 9, text));
    take(kRunChannel, chunk("a", "bank", "some digest", -1, 9, text));
    take(kRunChannel, chunk("a", "data:" + std::to_string(i), "another", 0, 1, text));
  }
  EXPECT_LT(view_.run_bytes(), 2 * kChunk);
  send_part("a", "bank", example_bank());
  EXPECT_TRUE(view_.bank());
}

TEST_F(LiveViewTest, ARunThatIsTooLargeLeavesRoomForTheNext) {
  const std::string text(kChunk, 'x');
  const auto count = static_cast<std::int32_t>(2 * LiveView::kRunBytes / kChunk);
  for (std::int32_t i = 0; i < count; ++i) {
    take(kRunChannel, chunk("large", "bank", "digest", i, count, text));
  }
  // To the last byte of the allowance.
  for (std::int32_t i = 1; i < 2000; ++i) {
    take(kRunChannel, chunk("large", "bank", "digest", count - i, count, std::string(100, 'x')));
  }
  EXPECT_FALSE(view_.bank());
  EXPECT_GT(view_.unreadable(), 0u);
  EXPECT_LE(view_.run_bytes(), LiveView::kRunBytes);
  send_part("b", "bank", example_bank());
  EXPECT_EQ(view_.run_id(), "b");
  EXPECT_TRUE(view_.bank());
  EXPECT_LT(view_.run_bytes(), 2 * example_bank().size() + kChunk);
}

TEST_F(LiveViewTest, EmptyChunksCountToo) {
  for (std::int32_t i = 0; i < 1'000'000; ++i) {
    take(kRunChannel, chunk("a", "bank", "digest", i, 1'000'000'000, ""));
  }
  EXPECT_GT(view_.unreadable(), 0u);
  EXPECT_LE(view_.run_bytes(), LiveView::kRunBytes);
}

TEST_F(LiveViewTest, AnotherTextOfAPartReplacesTheOneBefore) {
  const std::string& text = example_bank();
  const auto half = static_cast<std::int32_t>(text.size() / kChunk + 1);
  take(kRunChannel, chunk("a", "bank", "given up", 0, half, std::string(100, 'x')));
  send_part("a", "bank", text);
  EXPECT_TRUE(view_.bank());
}

TEST_F(LiveViewTest, ADamagedChunkIsMendedByItsRepetition) {
  const std::string& text = example_bank();
  std::string damaged = text.substr(0, 1000);
  damaged[500] ^= 0x20;
  const auto count = static_cast<std::int32_t>((text.size() + 999) / 1000);
  take(kRunChannel, chunk("a", "bank", text_digest(text), 0, count, damaged));
  send_part("a", "bank", text, 1000, 1);
  EXPECT_FALSE(view_.bank());
  send_part("a", "bank", text, 1000);
  EXPECT_TRUE(view_.bank());
}

TEST_F(LiveViewTest, ABankThatIsNoneIsCountedOnce) {
  for (int i = 0; i < 10; ++i) {
    send_part("a", "bank", "{\"schema\": 1}");
    send_part("a", "dbc", "no DBC");
  }
  EXPECT_FALSE(view_.bank());
  EXPECT_EQ(view_.unreadable(), 2u);
  send_residual(0, {0.1});
  EXPECT_THAT(state_json(view_, LiveView::Clock::now()), HasSubstr("0.1"));
}

TEST_F(LiveViewTest, ANewRunForgetsTheOneBefore) {
  send_part("a", "bank", example_bank());
  send_residual(7, {1.0, 0.1});
  send_part("b", "scenario", "schema = 1");
  EXPECT_FALSE(view_.bank());
  EXPECT_FALSE(view_.residual());
  EXPECT_TRUE(view_.least().empty());
  EXPECT_EQ(view_.lost(), 0u);
}

TEST_F(LiveViewTest, KeepsPeaksUntilTheyAreShown) {
  send_residual(0, {0.1, 0.4});
  send_residual(1, {0.9, 0.3});
  send_residual(2, {0.2, 0.2});
  EXPECT_THAT(view_.least(), ElementsAre(0.1, 0.2));
  EXPECT_THAT(view_.greatest(), ElementsAre(0.9, 0.4));
  view_.reset_peaks();
  send_residual(3, {0.3, 0.3});
  EXPECT_THAT(view_.greatest(), ElementsAre(0.3, 0.3));
}

TEST_F(LiveViewTest, CountsResidualsThatWereLost) {
  for (const std::int64_t sequence : {3, 4, 8, 9, 2, 3}) send_residual(sequence, {0.1});
  EXPECT_EQ(view_.lost(), 3u);
}

TEST_F(LiveViewTest, NumbersAtTheEndsOfTheirRangeDoNoHarm) {
  constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t kGreatest = std::numeric_limits<std::int64_t>::max();
  send_part("a", "bank", example_bank());
  for (const std::int64_t sequence : {kGreatest, kLeast, std::int64_t{0}, kGreatest}) {
    send_residual(sequence, {std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity(), -1e308});
    diagnosis_t diagnosis{};
    diagnosis.cycle = sequence;
    diagnosis.since_cycle = sequence == kLeast ? kGreatest : kLeast;
    diagnosis.verdict = "\xff\x1b[2J";
    take(kDiagnosisChannel, diagnosis);
    const auto now = LiveView::Clock::now();
    EXPECT_FALSE(state_json(view_, now).empty());
    EXPECT_THAT(terminal_picture(view_, {}, "url", now), testing::Not(HasSubstr("\x1b[2J")));
  }
}

TEST_F(LiveViewTest, TellsTheVerdictWithItsSetsAndHowLongItStands) {
  EXPECT_EQ(view_.verdict_text(), "");
  diagnosis_t diagnosis{};
  diagnosis.verdict = "ambiguous";
  diagnosis.cycle = 150;
  diagnosis.since_cycle = 100;
  diagnosis.set_count = 2;
  diagnosis.sets.resize(2);
  diagnosis.sets[0].fault_count = 1;
  diagnosis.sets[0].faults = {"u1"};
  diagnosis.sets[1].fault_count = 2;
  diagnosis.sets[1].faults = {"u2", "u3"};
  take(kDiagnosisChannel, diagnosis);
  EXPECT_EQ(view_.verdict_text(), "ambiguous u1 | u2+u3");
  EXPECT_FALSE(view_.verdict_age_s());
  send_part("", "bank", example_bank());  // 50 Hz
  take(kDiagnosisChannel, diagnosis);
  EXPECT_EQ(view_.verdict_age_s(), 1.0);
}

TEST_F(LiveViewTest, KeepsTheNewestEvents) {
  for (int i = 0; i < 1000; ++i) {
    event_t event{};
    event.sequence = i;
    event.text.assign(50000, 'x');
    take(kEventChannel, event);
  }
  ASSERT_EQ(view_.events().size(), LiveView::kEvents);
  EXPECT_EQ(view_.events().back().sequence, 999);
  EXPECT_LT(state_json(view_, LiveView::Clock::now()).size(), 1100 * LiveView::kEvents);
}

TEST_F(LiveViewTest, WhatFitsNoDatagramIsNotTheBenchs) {
  send_residual(0, {0.1});
  send_residual(1, std::vector<double>(100'000, 0.1));
  EXPECT_EQ(view_.unreadable(), 1u);
  EXPECT_EQ(view_.residual()->sequence, 0);
}

TEST_F(LiveViewTest, AnyBytesOnAnyChannelAreCountedAtMost) {
  const std::uint64_t seed = test_seed(20261124);
  SCOPED_TRACE(seed_message(seed));
  std::mt19937_64 draw(seed);
  const char* const channels[] = {kRunChannel,      kCanChannel,       kSampleChannel,
                                  kResidualChannel, kDiagnosisChannel, kTruthChannel,
                                  kEventChannel,    kStatsChannel,     "FAULTLINE_OTHER"};
  residual_t model{};
  model.row_count = model.filter_count = 2;
  model.residual = model.row_threshold = model.evaluation = model.threshold = {1.0, 2.0};
  model.fired = {1, 0};
  const std::vector<std::uint8_t> whole = encoded(model);
  for (int i = 0; i < 20'000; ++i) {
    std::vector<std::uint8_t> bytes = whole;
    bytes.resize(draw() % (whole.size() + 20));
    for (std::uint64_t n = draw() % 8; n > 0 && !bytes.empty(); --n) {
      bytes[draw() % bytes.size()] = static_cast<std::uint8_t>(draw());
    }
    take_bytes(channels[draw() % std::size(channels)], bytes);
  }
  EXPECT_GT(view_.unreadable(), 1000u);
  EXPECT_FALSE(state_json(view_, LiveView::Clock::now()).empty());
}

}  // namespace
}  // namespace faultline
