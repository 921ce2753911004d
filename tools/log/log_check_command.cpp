#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <CLI/App.hpp>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <nlohmann/json.hpp>

#include "tools/cli.h"
#include "tools/log/log_check.h"
#include "tools/log/log_command.h"

namespace faultline {
namespace {

using Json = nlohmann::ordered_json;

/// Ranges and damages shown to people; --json has them all.
constexpr std::size_t kShown = 10;

std::string range_text(const std::vector<NumberRange>& ranges) {
  std::vector<std::string> shown;
  for (const NumberRange& range : ranges) {
    if (shown.size() == kShown) {
      shown.push_back("..");
      break;
    }
    shown.push_back(range.first == range.last ? fmt::format("{}", range.first)
                                              : fmt::format("{}-{}", range.first, range.last));
  }
  return fmt::format("{}", fmt::join(shown, ", "));
}

std::string channel_text(const ChannelCheck& channel) {
  std::vector<std::string> remarks;
  if (!channel.missing.empty()) {
    remarks.push_back(
        fmt::format("MISSING {}: {}", count_of(channel.missing), range_text(channel.missing)));
  }
  if (channel.beyond > 0) {
    remarks.push_back(fmt::format("{} MORE than it says", channel.beyond));
  }
  if (channel.differing_repeats > 0) {
    remarks.push_back(
        fmt::format("{} DIFFER from the first of their number", channel.differing_repeats));
  } else if (channel.repeats > 0) {
    remarks.push_back(channel.is_complete() ? fmt::format("repeated {} times", channel.repeats)
                                            : fmt::format("{} TWICE", channel.repeats));
  }
  std::string text;
  if (!channel.published) {
    text = channel.missing.empty() ? "no gap" : "";
  } else if (channel.logged == static_cast<std::uint64_t>(*channel.published) &&
             channel.missing.empty()) {
    text = "published = logged";
  } else {
    text = fmt::format("of {} published", *channel.published);
  }
  if (!remarks.empty())
    text += fmt::format("{}{}", text.empty() ? "" : "; ", fmt::join(remarks, "; "));
  return text;
}

void print_frames(std::FILE* out, const FrameCheck& frames) {
  std::vector<std::string> remarks;
  if (!frames.missing.empty()) {
    remarks.push_back(
        fmt::format("MISSING {}: {}", count_of(frames.missing), range_text(frames.missing)));
  }
  if (frames.unlogged.value_or(0) > 0) {
    remarks.push_back(
        fmt::format("{} NOT LOGGED, as the run says itself: its queue was full", *frames.unlogged));
  }
  if (frames.malformed > 0) {
    remarks.push_back(fmt::format("{} that no bus could have carried", frames.malformed));
  }
  fmt::print(out, "  {:<22} {:>9}  {}\n", "frames", frames.logged,
             remarks.empty() ? "no gap" : fmt::format("{}", fmt::join(remarks, "; ")));
}

/// What the log is worth, in a sentence.
std::string conclusion(const RunCheck& run) {
  const std::string first = run.first_cycle ? fmt::format("{}", *run.first_cycle) : "?";
  const std::string last = run.last_cycle ? fmt::format("{}", *run.last_cycle) : "?";
  std::vector<std::string> sentences;
  if (run.begins_late) sentences.push_back(fmt::format("the log begins at cycle {}", first));
  if (!run.has_ended) {
    sentences.push_back(fmt::format(
        "the run did not end: the log stops at cycle {} (killed, still running, or cut)", last));
  }
  if (run.is_complete()) {
    sentences.push_back("complete: all that the run published is logged");
  } else if (run.has_no_gaps()) {
    sentences.push_back(!run.begins_late ? "complete up to there"
                        : run.has_ended  ? "complete from there"
                                         : "complete between them");
  } else {
    sentences.push_back("NOT COMPLETE");
  }
  return fmt::format("{}", fmt::join(sentences, "; "));
}

void print_run(std::FILE* out, const RunCheck& run) {
  fmt::print(out, "run {}{}\n", run.run_id.empty() ? "without RUN messages" : run.run_id,
             run.first_cycle ? fmt::format(", cycles {} to {}", *run.first_cycle, *run.last_cycle)
                             : std::string());
  for (const ChannelCheck& channel : run.channels) {
    fmt::print(out, "  {:<22} {:>9}  {}\n", channel.channel, channel.logged, channel_text(channel));
  }
  print_frames(out, run.frames);
  if (run.frames_dropped > 0) {
    fmt::print(out, "  the run lost {} frames between bus and diagnosis; no log can have them\n",
               run.frames_dropped);
  }
  if (run.records_dropped > 0) {
    fmt::print(out, "  {} diagnoses NOT LOGGED, as the run says itself: its queue was full\n",
               run.records_dropped);
  }
  for (const RunCheck::Part& part : run.parts) {
    if (!part.is_whole) {
      fmt::print(out, "  part {} ({}) is INCOMPLETE or differs from its digest\n", part.part,
                 part.name);
    }
  }
  if (run.parts.empty()) {
    fmt::print(out, "  what the run was made from (RUN) is MISSING: the log cannot be replayed\n");
  }
  fmt::print(out, "  {}\n", conclusion(run));
}

void print_check(std::FILE* out, const std::vector<std::string>& files, const LogCheck& check) {
  fmt::print(out, "{}: {} events\n", fmt::join(files, ", "), check.events);
  for (const RunCheck& run : check.runs) print_run(out, run);
  for (const auto& [type, count] : check.other_schema) {
    fmt::print(out, "another schema version: {} messages of {}\n", count, type);
  }
  for (const auto& [type, count] : check.undecodable) {
    fmt::print(out, "DAMAGED: {} messages of {}\n", count, type);
  }
  for (std::size_t i = 0; i < std::min(check.damages.size(), kShown); ++i) {
    fmt::print(out, "{}\n", describe(check.damages[i].file, check.damages[i].damage));
  }
  if (check.damages.size() > kShown) {
    fmt::print(out, "and {} more damages\n", check.damages.size() - kShown);
  }
  if (!check.other_channels.empty()) {
    std::vector<std::string> channels;
    for (const auto& [channel, count] : check.other_channels) {
      channels.push_back(fmt::format("{} ({})", channel, count));
    }
    fmt::print(out, "other channels, which only their events' numbers could prove complete: {}\n",
               fmt::join(channels, ", "));
  }
  if (check.missing_events > 0) {
    fmt::print(out, "{} events are missing by the numbers of those that are there{}\n",
               check.missing_events, check.runs.empty() ? "" : ": cut out, or damaged");
  } else if (check.runs.empty()) {
    fmt::print(out,
               "no message of a run of ours is in it: only events and damage could be checked; the "
               "events are numbered without a gap\n");
  }
}

Json json_of(const std::vector<NumberRange>& ranges) {
  Json json = Json::array();
  for (const NumberRange& range : ranges) json.push_back({range.first, range.last});
  return json;
}

template <class Value>
Json json_of(const std::optional<Value>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json json_of(const RunCheck& run) {
  Json json{{"run_id", run.run_id},
            {"complete", run.is_complete()},
            {"no_gaps", run.has_no_gaps()},
            {"begins_late", run.begins_late},
            {"ended", run.has_ended},
            {"first_cycle", json_of(run.first_cycle)},
            {"last_cycle", json_of(run.last_cycle)},
            {"channels", Json::object()},
            {"frames",
             {{"logged", run.frames.logged},
              {"missing", count_of(run.frames.missing)},
              {"missing_ranges", json_of(run.frames.missing)},
              {"unlogged", json_of(run.frames.unlogged)},
              {"malformed", run.frames.malformed},
              {"dropped", run.frames_dropped}}},
            {"records_dropped", run.records_dropped},
            {"parts", Json::array()}};
  for (const ChannelCheck& channel : run.channels) {
    json["channels"][channel.channel] = {{"logged", channel.logged},
                                         {"published", json_of(channel.published)},
                                         {"missing", count_of(channel.missing)},
                                         {"missing_ranges", json_of(channel.missing)},
                                         {"beyond", channel.beyond},
                                         {"repeats", channel.repeats},
                                         {"differing_repeats", channel.differing_repeats}};
  }
  for (const RunCheck::Part& part : run.parts) {
    json["parts"].push_back({{"part", part.part}, {"name", part.name}, {"whole", part.is_whole}});
  }
  return json;
}

Json json_of(const std::vector<std::string>& files, const LogCheck& check) {
  Json json{{"files", files},
            {"complete", check.is_complete()},
            {"events", check.events},
            {"missing_events", check.missing_events},
            {"runs", Json::array()},
            {"damages", Json::array()},
            {"other_schema", check.other_schema},
            {"undecodable", check.undecodable},
            {"other_channels", check.other_channels}};
  for (const RunCheck& run : check.runs) json["runs"].push_back(json_of(run));
  for (const FileDamage& damage : check.damages) {
    json["damages"].push_back({{"file", damage.file},
                               {"offset", damage.damage.offset},
                               {"bytes", damage.damage.bytes},
                               {"what", damage.damage.what},
                               {"at_end", damage.damage.is_end}});
  }
  return json;
}

struct CheckArguments {
  std::vector<std::string> files;
  std::string json;
};

int check(const CheckArguments& arguments) {
  const LogCheck check = check_log(arguments.files);
  print_check(human_output(arguments.json), arguments.files, check);
  if (!arguments.json.empty()) write_json(json_of(arguments.files, check), arguments.json);
  return check.is_complete() ? kExitYes : kExitNo;
}

}  // namespace

void add_log_check_command(CLI::App& parent, int& exit_code) {
  CLI::App* command = parent.add_subcommand(
      "check", "Is a log complete? Says published = logged, or what is missing and where");
  auto arguments = std::make_shared<CheckArguments>();
  add_log_files(*command, arguments->files);
  add_json_option(*command, arguments->json);
  command->footer(
      "Messages are numbered by channel, frames and events are numbered too, and the last message "
      "of a run says how many there were. Exit code 1: something is missing, or the log does not "
      "go from the run's first message to its last.\n" +
      std::string(kExitCodesHelp));
  command->callback([arguments, &exit_code] { exit_code = check(*arguments); });
}

}  // namespace faultline
