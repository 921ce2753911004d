// Whole runs in which the frames of protected messages are corrupted, doubled, lost or frozen on
// their way to the diagnosis.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <random>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <faultline/can_t.hpp>
#include <faultline/diagnosis_t.hpp>
#include <faultline/event_t.hpp>
#include <faultline/sample_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "drivers/signal/message_integrity.h"
#include "tests/support/allocation_guard.h"
#include "tests/support/random_seed.h"
#include "tests/tools/bench/changing_bus.h"
#include "tests/tools/bench/log_comparison.h"
#include "tools/bench/bench_run.h"
#include "tools/bench/run_summary.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

const std::filesystem::path kProtected =
    std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015" / "protected.toml";
constexpr std::uint32_t kSensors1 = 272, kSensors2 = 273, kCommands1 = 288, kSync = 256;

/// Applies `damage` to frames `first` .. `last` (counted from 0) of message `id`.
Change in_window(std::uint32_t id, std::uint64_t first, std::uint64_t last, Change damage) {
  return [=, seen = std::uint64_t{0}](const CanFrame& frame, std::deque<CanFrame>& out) mutable {
    const bool is_hit = frame.id == id && seen >= first && seen <= last;
    if (frame.id == id) ++seen;
    if (is_hit) return damage(frame, out);
    out.push_back(frame);
  };
}

void flip(const CanFrame& frame, std::deque<CanFrame>& out) {
  out.push_back(frame);
  out.back().data[3] ^= 0x41;
}

/// The example, in which u2 and u3 fail at 4 s. What it expects leaves time to forget (1.3 s) what
/// was wrong up to 1.7 s.
BenchInputs with_faults() {
  BenchInputs inputs = load_bench_inputs(kProtected);
  inputs.scenario.expectations.front().from_s = 3.1;
  return inputs;
}

BenchInputs without_faults() {
  BenchInputs inputs = load_bench_inputs(kProtected);
  inputs.scenario.expectations.clear();
  inputs.scenario.injections.clear();
  inputs.schedule = FaultSchedule(inputs.plant, {});
  return inputs;
}

std::vector<std::string> verdicts_of(const BenchResult& result) {
  std::vector<std::string> texts;
  for (const VerdictEntry& entry : result.history.verdicts()) texts.push_back(verdict_text(entry));
  return texts;
}

TEST(Integrity, ARunOfProtectedFramesIsWhatItIsWithoutProtection) {
  const BenchResult result =
      run_through(load_bench_inputs(kProtected),
                  [](const CanFrame& frame, std::deque<CanFrame>& out) { out.push_back(frame); });
  EXPECT_TRUE(result.history.are_expectations_met());
  EXPECT_EQ(result.counters.bad_samples, 0U);
  ASSERT_EQ(result.messages.size(), 5U);
  for (const MessageCounters& counters : result.messages) {
    EXPECT_TRUE(counters.is_integrity_clean());
    EXPECT_EQ(counters.integrity.frames, 1001U);
  }
}

TEST(Integrity, BlamesASensorWithWrongChecksumsAndIsolatesALaterFault) {
  const BenchInputs inputs = with_faults();
  const TemporaryFolder folder;
  const std::filesystem::path log = folder.path() / "run.lcm";
  const BenchResult result = run_through(inputs, in_window(kSensors1, 150, 169, flip), &log);

  EXPECT_THAT(verdicts_of(result),
              ElementsAre("inhibited", "healthy", "inhibited (Sensors1: wrong CRC)", "healthy",
                          "isolated u2, u3"));
  EXPECT_NEAR(result.history.verdicts()[2].t_s, 1.5, 1e-9);
  EXPECT_TRUE(result.history.are_expectations_met());
  EXPECT_EQ(result.counters.bad_samples, 20U);
  EXPECT_EQ(result.messages[0].integrity.wrong_crc, 20U);

  // On LCM: who is to blame, when it began and when it was over.
  std::vector<std::string> blames;
  for (const diagnosis_t& diagnosis : logged_messages<diagnosis_t>(log, kDiagnosisChannel)) {
    EXPECT_TRUE(diagnosis.blame.empty() || diagnosis.verdict == "inhibited");
    if (!diagnosis.blame.empty()) blames.push_back(diagnosis.blame);
  }
  ASSERT_FALSE(blames.empty());
  for (const std::string& blame : blames) EXPECT_EQ(blame, "Sensors1: wrong CRC");
  std::vector<std::string> events;
  for (const event_t& event : logged_messages<event_t>(log, kEventChannel)) {
    if (event.source == "diagnosis") events.push_back(event.text);
  }
  ASSERT_EQ(events.size(), 2U);
  EXPECT_EQ(events[0], "diagnosis inhibited: message Sensors1: wrong CRC");
  EXPECT_THAT(events[1], HasSubstr("(Sensors1: wrong CRC): 20 bad frames, 20 messages missing"));
  EXPECT_THAT(events[1], HasSubstr("diagnosis recovered after "));

  // y1 and y2 are held, with their age; y3 is not.
  for (const sample_t& sample : logged_messages<sample_t>(log, kSampleChannel)) {
    const bool is_hit = sample.cycle >= 150 && sample.cycle <= 169;
    const auto crc_error = static_cast<std::uint8_t>(SignalState::kCrcError);
    const std::uint8_t expected = is_hit ? crc_error : 0;
    EXPECT_THAT(sample.y_state, ElementsAre(expected, expected, 0)) << sample.cycle;
    EXPECT_EQ(sample.y_age[0], is_hit ? sample.cycle - 149 : 0);
    EXPECT_EQ(sample.y_is_fresh[0], is_hit ? 0 : 1);
  }
}

TEST(Integrity, TellsOfItInTheSummary) {
  const BenchInputs inputs = with_faults();
  BenchOptions options;
  options.bus = "loop";
  const BenchResult result = run_through(inputs, in_window(kSensors1, 300, 305, flip));
  const nlohmann::ordered_json json = summary_json(inputs, options, result);
  EXPECT_EQ(json["verdicts"][2]["blame"], "Sensors1: wrong CRC");
  EXPECT_FALSE(json["verdicts"][1].contains("blame"));
  EXPECT_EQ(json["messages"][0]["message"], "Sensors1");
  EXPECT_EQ(json["messages"][0]["wrong_crc"], 6);
  EXPECT_EQ(json["messages"][1]["wrong_crc"], 0);

  std::FILE* const file = std::tmpfile();
  ASSERT_NE(file, nullptr);
  print_summary(file, inputs, options, result);
  std::string text(static_cast<std::size_t>(std::ftell(file)), '\0');
  std::rewind(file);
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  EXPECT_THAT(text, HasSubstr("WARNING  Sensors1: 6 wrong CRC (of 1001 frames)\n"));
  EXPECT_THAT(text, testing::Not(HasSubstr("WARNING  Sensors2")));
}

TEST(Integrity, BlamesACommandThatTheDiagnosisCannotTrust) {
  const BenchResult result = run_through(with_faults(), in_window(kCommands1, 150, 159, flip));
  EXPECT_THAT(verdicts_of(result),
              ElementsAre("inhibited", "healthy", "inhibited (Commands1: wrong CRC)", "healthy",
                          "isolated u2, u3"));
  EXPECT_TRUE(result.history.are_expectations_met());
}

TEST(Integrity, BlamesSync) {
  const BenchResult result = run_through(with_faults(), in_window(kSync, 150, 159, flip));
  EXPECT_THAT(verdicts_of(result),
              ElementsAre("inhibited", "healthy", "inhibited (Sync: wrong CRC)", "healthy",
                          "isolated u2, u3"));
  EXPECT_TRUE(result.history.are_expectations_met());
}

TEST(Integrity, BlamesASenderWhoseCounterFroze) {
  const BenchInputs inputs = with_faults();
  const MessageProtection protection = inputs.map.message_protection(1);
  const auto freeze = [protection](const CanFrame& frame, std::deque<CanFrame>& out) {
    out.push_back(frame);
    // Everything but the counter goes on, and the checksum is right for it.
    protection.write(std::span(out.back().data).first(frame.length), 149 % 15);
  };
  const BenchResult result = run_through(inputs, in_window(kSensors2, 150, 170, freeze));
  EXPECT_THAT(verdicts_of(result),
              ElementsAre("inhibited", "healthy", "inhibited (Sensors2: counter repeated)",
                          "healthy", "isolated u2, u3"));
  EXPECT_TRUE(result.history.are_expectations_met());
  EXPECT_EQ(result.messages[1].integrity.repeated, 21U);
}

TEST(Integrity, BlamesAMessageThatIsMissing) {
  const BenchResult result = run_through(
      with_faults(), in_window(kSensors2, 150, 160, [](const CanFrame&, std::deque<CanFrame>&) {}));
  EXPECT_THAT(verdicts_of(result),
              ElementsAre("inhibited", "healthy", "inhibited (Sensors2: missing)", "healthy",
                          "isolated u2, u3"));
  EXPECT_EQ(result.messages[1].integrity.lost, 11U);
  EXPECT_EQ(result.messages[1].missing, 11U);
}

TEST(Integrity, StaysInhibitedWhileAFaultBeginsAndIsolatesItAfterwards) {
  // The fault of 4 s begins in the middle of it.
  const BenchInputs inputs = with_faults();
  const BenchResult result = run_through(inputs, in_window(kSensors1, 380, 420, flip));
  const std::vector<std::string> verdicts = verdicts_of(result);
  EXPECT_EQ(verdicts.back(), "isolated u2, u3");
  for (std::size_t i = 0; i + 1 < verdicts.size(); ++i) {
    EXPECT_FALSE(verdicts[i].starts_with("isolated")) << verdicts[i];
  }
}

/// Flips bits within one byte (a checksum finds any burst of up to 8 bits), loses and doubles
/// frames, freezes counters; all messages, in bouts.
class HostileLine {
 public:
  HostileLine(std::uint64_t seed, const SignalMap& map) : draw_(seed), map_(&map) {}

  void operator()(const CanFrame& frame, std::deque<CanFrame>& out) {
    if (frame.id == kSync) ++cycle_;
    if (cycle_ % 250 >= 40) return out.push_back(frame);
    switch (draw_() % 16) {
      case 0:
        return;
      case 1:
        out.push_back(frame);
        out.push_back(frame);
        return;
      case 2:
      case 3: {
        out.push_back(frame);
        const std::size_t byte = draw_() % frame.length;
        std::uint8_t& hit = out.back().data[byte];
        hit = static_cast<std::uint8_t>(hit ^ (1 + draw_() % 255));
        return;
      }
      case 4:
        out.push_back(frame);
        for (std::size_t i = 0; i < map_->sensor_messages.size(); ++i) {
          if (!map_->sensor_messages[i].matches(frame)) continue;
          // The counter of the frame before.
          const MessageProtection& protection = map_->sensor_messages[i].protection;
          const std::uint64_t count = (protection.count(frame.payload()) + 14) % 15;
          protection.write(std::span(out.back().data).first(frame.length), count);
        }
        return;
      default:
        out.push_back(frame);
    }
  }

 private:
  std::mt19937_64 draw_;
  const SignalMap* map_;
  std::uint64_t cycle_ = 0;
};

TEST(Integrity, NothingThatChecksumsFindLooksLikeAFault) {
  const std::uint64_t seed = test_seed(100);
  SCOPED_TRACE(seed_message(seed));
  const BenchInputs inputs = without_faults();
  std::uint64_t bad_samples = 0;
  for (std::uint64_t round = 0; round < 50; ++round) {
    const BenchResult result = run_through(inputs, HostileLine(seed + round, inputs.map));
    bad_samples += result.counters.bad_samples;
    for (const VerdictEntry& entry : result.history.verdicts()) {
      EXPECT_TRUE(entry.verdict == Verdict::kHealthy || entry.verdict == Verdict::kInhibited)
          << verdict_text(entry) << " at " << entry.t_s << " s in round " << round;
    }
  }
  EXPECT_GT(bad_samples, 50U * 50U);
}

TEST(Integrity, FindsTheFaultBetweenBoutsOfAHostileLine) {
  const std::uint64_t seed = test_seed(200);
  SCOPED_TRACE(seed_message(seed));
  const BenchInputs inputs = with_faults();
  for (std::uint64_t round = 0; round < 20; ++round) {
    const BenchResult result = run_through(inputs, HostileLine(seed + round, inputs.map));
    bool is_isolated = false;
    for (const VerdictEntry& entry : result.history.verdicts()) {
      const std::string text = verdict_text(entry);
      is_isolated = is_isolated || text == "isolated u2, u3";
      EXPECT_TRUE(!text.starts_with("isolated") || text == "isolated u2, u3") << text;
      EXPECT_TRUE(entry.t_s >= 4.0 || !text.starts_with("isolated")) << text;
    }
    EXPECT_TRUE(is_isolated);
  }
}

struct NullSink final : DiagnosisSink {
  void on_received(const CanFrame& /*frame*/) noexcept override {}
  void on_record(const DiagnosisRecord& record) noexcept override {
    blamed += record.fault != MessageFault::kNone ? 1U : 0U;
  }
  std::uint64_t blamed = 0;
};

TEST(Integrity, TheDiagnosisDoesNotAllocateWhateverComes) {
  const BenchInputs inputs = with_faults();
  std::vector<CanFrame> frames;
  HostileLine line(7, inputs.map);
  run_through(inputs, [&](const CanFrame& frame, std::deque<CanFrame>& out) {
    const std::size_t before = out.size();
    line(frame, out);
    frames.insert(frames.end(), out.begin() + static_cast<std::ptrdiff_t>(before), out.end());
  });
  DiagnosisNode node(inputs.map, inputs.bank, false);
  NullSink sink;
  const AllocationGuard guard;
  for (const CanFrame& frame : frames) node.on_frame(frame, sink);
  node.finish(sink);
  const std::uint64_t calls = guard.heap_calls();
  EXPECT_EQ(calls, 0U);
  EXPECT_GT(frames.size(), 4000U);
  EXPECT_GT(sink.blamed, 100U);
}

// On the loop bus a frame keeps the bus that its sender gave it.
TEST(Integrity, LogsFramesByTheBusOnWhichTheirMessageLives) {
  const TemporaryFolder folder;
  std::filesystem::copy(kProtected.parent_path(), folder.path(),
                        std::filesystem::copy_options::recursive);
  std::ofstream(folder.path() / "bench_protected.dbc", std::ios::app)
      << "BA_DEF_ BO_ \"FaultlineBus\" INT 0 255;\nBA_DEF_DEF_ \"FaultlineBus\" 0;\n"
         "BA_ \"FaultlineBus\" BO_ 273 1;\n";
  const BenchInputs inputs = load_bench_inputs(folder.path() / "protected.toml");
  const std::filesystem::path log = folder.path() / "run.lcm";
  const BenchResult result = run_through(
      inputs, [](const CanFrame& frame, std::deque<CanFrame>& out) { out.push_back(frame); }, &log);
  EXPECT_TRUE(result.history.are_expectations_met());
  std::size_t on_bus_1 = 0;
  std::size_t frames = 0;
  for (const can_t& can : logged_messages<can_t>(log, kCanChannel)) {
    EXPECT_EQ(can.first_frame, static_cast<std::int64_t>(frames));
    for (const can_frame_t& frame : can.frames) {
      EXPECT_EQ(can.bus, static_cast<std::uint32_t>(frame.id) == kSensors2 ? 1 : 0);
      on_bus_1 += can.bus == 1 ? 1U : 0U;
      ++frames;
    }
  }
  EXPECT_EQ(on_bus_1, 1001U);
  EXPECT_EQ(frames, 5005U);
}

TEST(Integrity, TheSameFramesGiveTheSameBits) {
  const BenchInputs inputs = with_faults();
  const TemporaryFolder folder;
  const std::filesystem::path a = folder.path() / "a.lcm";
  const std::filesystem::path b = folder.path() / "b.lcm";
  const BenchResult first = run_through(inputs, HostileLine(5, inputs.map), &a);
  const BenchResult second = run_through(inputs, HostileLine(5, inputs.map), &b);
  EXPECT_EQ(verdicts_of(first), verdicts_of(second));
  const auto residuals = logged_residuals(a);
  EXPECT_GT(residuals.size(), 990U);  // the first cycles may be lost
  EXPECT_EQ(first_difference(residuals, logged_residuals(b)), residuals.size());
}

}  // namespace
}  // namespace faultline
