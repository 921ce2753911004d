#include "tools/replay/log_replay.h"

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <faultline/residual_t.hpp>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/model/input_error.h"
#include "drivers/signal/signal_map.h"
#include "tests/tools/bench/log_comparison.h"
#include "tests/tools/replay/edited_log.h"
#include "tools/bench/bench.h"
#include "tools/can/frame_log.h"
#include "tools/lcm/channels.h"

namespace faultline {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

const std::filesystem::path kExample = std::filesystem::path(FAULTLINE_EXAMPLES_DIR) / "hou2015";
constexpr auto kResidual = ResultChannel::kResidual;

/// One run of the example (10 s, u2 and u3 fail at 4 s) in the folder of the suite.
class LogReplay : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TemporaryFolder>();
    const BenchInputs inputs = load_bench_inputs(kExample / "demo.toml");
    BenchOptions options;
    options.bus = "loop";
    options.log = log();
    const BenchResult result = run_bench(inputs, options);
    ASSERT_TRUE(result.history.are_expectations_met());
    write_bank(inputs.bank, file("pairs.bank.json"));
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static std::filesystem::path file(const std::string& name) { return folder_->path() / name; }
  static std::filesystem::path log() { return file("demo.lcm"); }

  /// The log with changes, as another file.
  static std::filesystem::path edited(const std::function<bool(EditedEvent&)>& edit) {
    const std::filesystem::path to = file("edited.lcm");
    edit_log(log(), to, edit);
    return to;
  }
  static ReplayResult replay_of(const std::vector<std::filesystem::path>& logs) {
    ReplayOptions options;
    for (const std::filesystem::path& file : logs) options.logs.push_back(file.string());
    return replay(options);
  }
  static RunReplay replay_one(const std::filesystem::path& log) {
    ReplayResult result = replay_of({log});
    EXPECT_THAT(result.runs, SizeIs(1));
    return std::move(result.runs.front());
  }
  static std::string error_of(const ReplayOptions& options) {
    try {
      static_cast<void>(replay(options));
    } catch (const std::exception& error) {
      return error.what();
    }
    return "no error";
  }
  static std::vector<std::string> verdicts_of(const BankAnswer& answer) {
    std::vector<std::string> texts;
    for (const VerdictEntry& entry : answer.verdicts) texts.push_back(verdict_text(entry));
    return texts;
  }

  static std::unique_ptr<TemporaryFolder> folder_;
};
std::unique_ptr<TemporaryFolder> LogReplay::folder_;

TEST_F(LogReplay, ReproducesARunToTheBit) {
  const RunReplay run = replay_one(log());
  EXPECT_TRUE(run.has_ended);
  EXPECT_EQ(run.frames, 5005U);
  ASSERT_TRUE(run.verification);
  EXPECT_TRUE(run.verification->is_verified());
  EXPECT_EQ(run.verification->comparison.counts(kResidual).identical, 1001U);
  EXPECT_EQ(run.verification->comparison.counts(ResultChannel::kSample).identical, 1001U);
  EXPECT_GT(run.verification->comparison.counts(ResultChannel::kDiagnosis).identical, 10U);
  EXPECT_GT(run.verification->comparison.counts(ResultChannel::kEstimate).identical, 5U);
  ASSERT_THAT(run.answers, SizeIs(1));
  EXPECT_THAT(verdicts_of(run.answers[0]), ElementsAre("inhibited", "healthy", "isolated u2, u3"));
  EXPECT_TRUE(run.answers[0].are_expectations_met());
}

TEST_F(LogReplay, FindsOneBitThatDiffersInOneResidual) {
  const RunReplay run = replay_one(edited([](EditedEvent& event) {
    // fingerprint, utime, sequence, cycle, row_count, then the residuals
    constexpr std::size_t kSecondResidual = 4 * 8 + 4 + 8;
    if (event.channel == kResidualChannel && event.index == 412) {
      event.data[kSecondResidual + 7] ^= 1;
    }
    return true;
  }));
  ASSERT_TRUE(run.verification);
  EXPECT_FALSE(run.verification->is_verified());
  EXPECT_EQ(run.verification->comparison.total().different, 1U);
  ASSERT_THAT(run.verification->difference, SizeIs(2));
  EXPECT_EQ(run.verification->difference[0], "FAULTLINE_RESIDUAL, cycle 412");
  EXPECT_THAT(run.verification->difference[1],
              AllOf(HasSubstr("residual r13: recorded "), HasSubstr(", replayed ")));
}

/// A run of the example with filters that have a course, a Lipschitz term and a persistence.
std::filesystem::path observer_run(const std::filesystem::path& log) {
  BenchInputs inputs = load_bench_inputs(kExample / "demo.toml");
  ResidualFilter& filter = inputs.bank.filters[1];
  const Eigen::VectorXd norm = Eigen::Vector3d(1.0, 0.5, filter.threshold);
  filter.course = ThresholdCourse{Eigen::MatrixXd::Ones(1, 1), norm, norm};
  filter.transient_samples = 30;
  FilterNonlinearity term;
  term.W = Eigen::VectorXd::Constant(filter.F.rows(), 1e-4);
  term.a_v = Eigen::VectorXd::Ones(filter.F.rows());
  term.a_y = Eigen::VectorXd::Ones(filter.H.cols());
  term.a_u = Eigen::VectorXd::Ones(filter.K.cols());
  filter.nonlinearities = {term};
  for (RunPart& part : inputs.parts) {
    if (part.part == "bank") part.text = bank_text(inputs.bank);
  }
  BenchOptions options;
  options.bus = "loop";
  options.log = log;
  static_cast<void>(run_bench(inputs, options));
  return log;
}

TEST_F(LogReplay, ReproducesARunWithObserversToTheBit) {
  const std::filesystem::path log = observer_run(file("observers.lcm"));
  const auto residuals = logged_messages<residual_t>(log, kResidualChannel);
  ASSERT_EQ(residuals.size(), 1001U);
  EXPECT_EQ(residuals[0].row_threshold.at(1), 1.0);
  EXPECT_EQ(residuals[1].threshold.at(1), 0.5);
  EXPECT_LT(residuals[2].row_threshold.at(0), 0.0) << "a linear filter has none";
  const RunReplay run = replay_one(log);
  ASSERT_TRUE(run.verification);
  EXPECT_TRUE(run.verification->is_verified());
  EXPECT_EQ(run.verification->comparison.counts(kResidual).identical, 1001U);
}

TEST_F(LogReplay, FindsOneBitThatDiffersInOneRowThreshold) {
  const std::filesystem::path log = observer_run(file("observers.lcm"));
  const std::filesystem::path edited = file("edited.lcm");
  edit_log(log, edited, [](EditedEvent& event) {
    // fingerprint, utime, sequence, cycle, row_count, six residuals, then their thresholds
    constexpr std::size_t kSecondThreshold = 4 * 8 + 4 + 6 * 8 + 8;
    if (event.channel == kResidualChannel && event.index == 412) {
      event.data[kSecondThreshold + 7] ^= 1;
    }
    return true;
  });
  const RunReplay run = replay_one(edited);
  ASSERT_TRUE(run.verification);
  EXPECT_EQ(run.verification->comparison.total().different, 1U);
  ASSERT_THAT(run.verification->difference, SizeIs(2));
  EXPECT_THAT(run.verification->difference[1], HasSubstr("row threshold r13: recorded "));
}

TEST_F(LogReplay, FindsADiagnosisThatTheFramesDoNotGive) {
  const RunReplay run = replay_one(edited([](EditedEvent& event) {
    std::string text(event.data.begin(), event.data.end());
    const std::size_t at = text.find("isolated");
    if (event.channel == kDiagnosisChannel && at != std::string::npos) event.data[at] = 'I';
    return true;
  }));
  ASSERT_TRUE(run.verification);
  ASSERT_THAT(run.verification->difference, SizeIs(2));
  EXPECT_EQ(run.verification->difference[0], "FAULTLINE_DIAGNOSIS, cycle 407");
  EXPECT_EQ(run.verification->difference[1],
            "  verdict: recorded \"Isolated\", replayed \"isolated\"");
}

TEST_F(LogReplay, AFrameThatDiffersShowsInTheSampleFirst) {
  const RunReplay run = replay_one(edited([](EditedEvent& event) {
    constexpr std::size_t kFirstPayload = 4 * 8 + 2 * 4 + 8 + 4 + 2;  // can_t, can_frame_t
    if (event.channel == kCanChannel && event.index == 40) event.data[kFirstPayload] ^= 0x10;
    return true;
  }));
  ASSERT_TRUE(run.verification);
  ASSERT_FALSE(run.verification->difference.empty());
  EXPECT_THAT(run.verification->difference[0], HasSubstr("FAULTLINE_SAMPLE, cycle "));
}

TEST_F(LogReplay, SaysWhatIsNotVerifiableWhereFramesAreMissing) {
  const RunReplay run = replay_one(edited([](EditedEvent& event) {
    return !(event.channel == kCanChannel && event.index == 30);  // 64 frames of cycles 384 .. 396
  }));
  EXPECT_EQ(run.missing_frames, 64U);
  ASSERT_TRUE(run.verification);
  const ResultComparison& comparison = run.verification->comparison;
  EXPECT_FALSE(run.verification->is_verified());
  EXPECT_EQ(comparison.total().different, 0U);
  EXPECT_GT(comparison.total().unverifiable, 10U);
  // What came before it, and what came long enough behind it, is.
  ASSERT_FALSE(comparison.unverifiable().empty());
  EXPECT_EQ(comparison.unverifiable().front().from, 384);
  EXPECT_LT(comparison.unverifiable().back().to, 900);
  EXPECT_GT(comparison.counts(kResidual).identical, 384U + 100U);
  EXPECT_EQ(comparison.counts(kResidual).recorded, 1001U);
}

TEST_F(LogReplay, BatchesThatALoggerHeardInAnotherOrderAreNoGap) {
  std::optional<EditedEvent> held;
  const std::filesystem::path to = file("swapped.lcm");
  const auto out = open_log(to);
  LogReader reader(log());
  std::uint64_t batches = 0;
  while (const LogEvent* event = reader.next()) {
    const bool is_held = event->channel == kCanChannel && ++batches % 10 == 0;
    if (is_held) {
      held = EditedEvent{.data = {event->data.begin(), event->data.end()}};
      continue;
    }
    out->publish(std::string(event->channel).c_str(), event->utime, event->data);
    if (event->channel == kCanChannel && held) {
      out->publish(kCanChannel, event->utime, held->data);
      held.reset();
    }
  }
  out->close();
  const RunReplay run = replay_one(to);
  EXPECT_EQ(run.missing_frames, 0U);
  ASSERT_TRUE(run.verification);
  EXPECT_TRUE(run.verification->is_verified());
}

TEST_F(LogReplay, ALogThatWasCutShortIsVerifiedUpToItsEnd) {
  const auto size = std::filesystem::file_size(log());
  for (const std::uintmax_t kept : {size / 4, size / 2, size - 1}) {
    const std::filesystem::path cut = file("cut.lcm");
    std::filesystem::copy_file(log(), cut, std::filesystem::copy_options::overwrite_existing);
    std::filesystem::resize_file(cut, kept);
    const RunReplay run = replay_one(cut);
    ASSERT_TRUE(run.verification);
    EXPECT_TRUE(run.verification->is_verified()) << kept;
    EXPECT_FALSE(run.has_ended);
    EXPECT_GT(run.verification->comparison.total().identical, 300U) << kept;
  }
}

TEST_F(LogReplay, ALogThatBeginsInTheMiddleIsVerifiedOnceTheBankHasForgotten) {
  const RunReplay run = replay_one(edited([](EditedEvent& event) {
    return event.channel == kRunChannel || event.utime == 0 ||
           (event.channel == kCanChannel ? event.index >= 20 : event.index >= 256);
  }));
  ASSERT_TRUE(run.verification);
  EXPECT_EQ(run.missing_frames, 20U * 64U);
  EXPECT_EQ(run.verification->comparison.total().different, 0U);
  EXPECT_GT(run.verification->comparison.counts(kResidual).identical, 100U);
}

TEST_F(LogReplay, PartsThatComeBehindTheFirstFramesAreFound) {
  std::vector<EditedEvent> late;
  const std::filesystem::path to = edited([&](EditedEvent& event) {
    if (event.channel != kRunChannel) return true;
    late.push_back(event);
    return false;
  });
  ASSERT_FALSE(late.empty());
  const std::filesystem::path parts = file("parts.lcm");
  const auto sink = open_log(parts);
  for (const EditedEvent& event : late) {
    sink->publish(event.channel.c_str(), event.utime, event.data);
  }
  sink->close();
  std::ofstream(to, std::ios::binary | std::ios::app)
      << std::ifstream(parts, std::ios::binary).rdbuf();
  const RunReplay run = replay_one(to);
  ASSERT_TRUE(run.verification);
  EXPECT_TRUE(run.verification->is_verified());
}

TEST_F(LogReplay, SeveralFilesAreOneRun) {
  const std::filesystem::path first = file("first.lcm"), second = file("second.lcm");
  std::uint64_t events = 0;
  const auto is_first = [&] { return events++ < 1200; };
  edit_log(log(), first, [&](EditedEvent&) { return is_first(); });
  events = 0;
  edit_log(log(), second,
           [&](EditedEvent& event) { return !is_first() || event.channel == kRunChannel; });
  const ReplayResult result = replay_of({first, second});
  ASSERT_THAT(result.runs, SizeIs(1));
  ASSERT_TRUE(result.runs[0].verification);
  EXPECT_TRUE(result.runs[0].verification->is_verified());
  EXPECT_EQ(result.runs[0].verification->comparison.counts(kResidual).identical, 1001U);
}

TEST_F(LogReplay, TwoRunsInOneLogAreReplayedOneAfterTheOther) {
  const std::filesystem::path other = file("fig15.lcm"), both = file("both.lcm");
  BenchOptions options;
  options.bus = "loop";
  options.log = other;
  static_cast<void>(run_bench(load_bench_inputs(kExample / "fig15.toml"), options));
  std::ofstream(both, std::ios::binary) << std::ifstream(log(), std::ios::binary).rdbuf()
                                        << std::ifstream(other, std::ios::binary).rdbuf();
  const ReplayResult result = replay_of({both});
  ASSERT_THAT(result.runs, SizeIs(2));
  EXPECT_EQ(result.runs[0].name, "demo");
  EXPECT_EQ(result.runs[1].name, "fig15");
  for (const RunReplay& run : result.runs) {
    ASSERT_TRUE(run.verification);
    EXPECT_TRUE(run.verification->is_verified()) << run.name;
    EXPECT_TRUE(run.has_ended);
  }
}

TEST_F(LogReplay, SaysWhatAnotherBankWouldHaveSaid) {
  Bank blind = read_bank(file("pairs.bank.json"));
  for (ResidualFilter& filter : blind.filters) filter.threshold = 100.0;
  blind.name = "blind";
  write_bank(blind, file("blind.bank.json"));
  ReplayOptions options;
  options.logs = {log()};
  options.bank = file("blind.bank.json");
  options.output = file("blind.lcm");
  const ReplayResult result = replay(options);
  ASSERT_THAT(result.runs, SizeIs(1));
  const RunReplay& run = result.runs[0];
  EXPECT_TRUE(run.verification && run.verification->is_verified());
  ASSERT_THAT(run.answers, SizeIs(2));
  EXPECT_THAT(verdicts_of(run.answers[0]), ElementsAre("inhibited", "healthy", "isolated u2, u3"));
  EXPECT_EQ(run.answers[1].bank, "blind");
  EXPECT_THAT(verdicts_of(run.answers[1]), ElementsAre("inhibited", "healthy"));
  EXPECT_FALSE(run.answers[1].are_expectations_met());
  // And what it said, its own log shows again, and what it was made from.
  const RunReplay again = replay_one(file("blind.lcm"));
  ASSERT_TRUE(again.verification);
  EXPECT_TRUE(again.verification->is_verified());
  EXPECT_TRUE(again.has_ended);
  EXPECT_EQ(again.name, "demo");
  EXPECT_FALSE(again.answers[0].are_expectations_met());
  EXPECT_THAT(verdicts_of(again.answers[0]), ElementsAre("inhibited", "healthy"));
}

TEST_F(LogReplay, ReadsACandumpLogWithABankAndADbc) {
  const std::filesystem::path text = file("demo.log");
  {
    const auto writer = open_frame_log(text.string());
    FrameLogReceiver receiver;
    receiver.on_frame = [&](const CanFrame& frame, std::string_view bus) {
      writer->write(frame, bus);
    };
    receiver.on_problem = [](const std::string& problem) { ADD_FAILURE() << problem; };
    static_cast<void>(read_frame_log(log().string(), nullptr, receiver));
    writer->close();
  }
  ReplayOptions options;
  options.logs = {text};
  options.bank = file("pairs.bank.json");
  options.dbc = kExample / "bench.dbc";
  options.output = file("from_candump.lcm");
  const ReplayResult result = replay(options);
  ASSERT_THAT(result.runs, SizeIs(1));
  EXPECT_FALSE(result.runs[0].verification);
  ASSERT_THAT(result.runs[0].answers, SizeIs(1));
  EXPECT_THAT(verdicts_of(result.runs[0].answers[0]),
              ElementsAre("inhibited", "healthy", "isolated u2, u3"));
  // A candump log has all that the decisions are made from.
  const auto expected = logged_residuals(log());
  const auto found = logged_residuals(*options.output);
  EXPECT_EQ(found.size(), expected.size());
  EXPECT_EQ(first_difference(expected, found), expected.size());
}

TEST_F(LogReplay, NumbersThatNoRunCountsToAreDamage) {
  const RunReplay run = replay_one(edited([](EditedEvent& event) {
    constexpr std::size_t kSequenceAt = 16, kFramesReceivedAt = 8 + 3 * 8 + 1 + 2 * 8;  // stats_t
    const bool is_hit = event.channel == kResidualChannel && event.index == 500;
    if (is_hit) event.data[kSequenceAt] = 0x80;
    if (event.channel == kStatsChannel) event.data[kFramesReceivedAt] = 0x80;
    return true;
  }));
  ASSERT_TRUE(run.verification);
  EXPECT_TRUE(run.verification->is_verified());
  EXPECT_EQ(run.verification->comparison.counts(kResidual).recorded, 1000U);
  EXPECT_EQ(run.verification->comparison.counts(kResidual).unrecorded, 1U);
}

TEST_F(LogReplay, RefusesABankThatDoesNotFit) {
  Bank bank = read_bank(file("pairs.bank.json"));
  Bank renamed = bank;
  renamed.output_names[0] = "y9";
  write_bank(renamed, file("renamed.bank.json"));
  ReplayOptions options;
  options.logs = {log()};
  options.bank = file("renamed.bank.json");
  EXPECT_THAT(error_of(options), HasSubstr("y9"));

  Bank foreign = bank;
  foreign.plant_digest = "another";
  write_bank(foreign, file("foreign.bank.json"));
  options.bank = file("foreign.bank.json");
  EXPECT_EQ(error_of(options), "no error");  // it has the channels
  options.output = file("foreign.lcm");
  EXPECT_THAT(error_of(options), HasSubstr("plant: found digest another"));
  options.output.reset();

  Bank slower = bank;
  slower.sample_time_s = 0.02;
  write_bank(slower, file("slower.bank.json"));
  options.bank = file("slower.bank.json");
  EXPECT_THAT(error_of(options), AllOf(HasSubstr("slower.bank.json"),
                                       HasSubstr("sample_time_s: found 0.02 s, expected "
                                                 "0.01 s")));
}

TEST_F(LogReplay, RefusesLogsThatCannotBeReplayed) {
  ReplayOptions options;
  options.logs = {edited([](EditedEvent& event) { return event.channel != kCanChannel; })};
  EXPECT_THAT(error_of(options), AllOf(HasSubstr("edited.lcm"), HasSubstr("FAULTLINE_CAN")))
      << "no frames, only results";

  options.logs = {edited([](EditedEvent& event) { return event.channel != kRunChannel; })};
  EXPECT_THAT(error_of(options), HasSubstr("found no bank in it, expected one with --scenario"));

  options.logs = {edited([](EditedEvent& event) {
    if (event.channel == kSampleChannel) event.data[3] ^= 1;
    return true;
  })};
  EXPECT_THAT(error_of(options), AllOf(HasSubstr("FAULTLINE_SAMPLE"), HasSubstr("fingerprint")));

  options.logs = {file("foreign.lcm")};
  const auto foreign = open_log(options.logs[0]);
  const std::vector<std::uint8_t> bytes(40, 1);
  foreign->publish("POSE", 1, bytes);
  foreign->close();
  EXPECT_THAT(error_of(options), HasSubstr("found no message on FAULTLINE_CAN"));

  options.logs = {file("empty.log")};
  std::ofstream(options.logs[0]) << "";
  EXPECT_NE(error_of(options), "no error");
  options.logs = {file("none.lcm")};
  EXPECT_THAT(error_of(options), HasSubstr("none.lcm"));
}

}  // namespace
}  // namespace faultline
