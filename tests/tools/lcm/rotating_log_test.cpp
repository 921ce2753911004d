#include "tools/lcm/rotating_log.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tools/lcm/channels.h"
#include "tools/lcm/log_reader.h"

namespace faultline {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

class RotatingLogTest : public ::testing::Test {
 protected:
  RotatingLogTest() {
    std::string name =
        (std::filesystem::temp_directory_path() / "rotating_log_test.XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("mkdtemp");
    folder_ = name;
  }
  ~RotatingLogTest() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::vector<std::string> files() const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      names.push_back(entry.path().filename().string());
    }
    std::sort(names.begin(), names.end());
    return names;
  }
  /// "CHANNEL payload" of its events.
  [[nodiscard]] std::vector<std::string> events(const std::string& name) const {
    std::vector<std::string> events;
    LogReader log(folder_ / name);
    while (const LogEvent* event = log.next()) {
      events.push_back(std::string(event->channel) + " " +
                       std::string(event->data.begin(), event->data.end()));
    }
    EXPECT_THAT(log.damages(), IsEmpty());
    return events;
  }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
  }

  std::filesystem::path folder_;
};

void publish(MessageSink& sink, const char* channel, std::int64_t utime, const std::string& text) {
  sink.publish(channel, utime, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

TEST_F(RotatingLogTest, BeginsANewFileByTimeAndRepeatsWhatTheRunWasMadeFrom) {
  LogSplit split;
  split.time_us = 10;
  const auto log = open_rotating_log(folder_ / "run.lcm", split);
  publish(*log, kRunChannel, 100, "plant");
  publish(*log, kRunChannel, 100, "bank");
  publish(*log, "A", 100, "1");
  publish(*log, "A", 109, "2");
  publish(*log, "A", 110, "3");
  publish(*log, "A", 119, "4");
  publish(*log, "A", 1000, "5");
  log->close();
  EXPECT_THAT(files(), ElementsAre("run-0001.lcm", "run-0002.lcm", "run-0003.lcm"));
  EXPECT_THAT(events("run-0001.lcm"),
              ElementsAre("FAULTLINE_RUN plant", "FAULTLINE_RUN bank", "A 1", "A 2"));
  EXPECT_THAT(events("run-0002.lcm"),
              ElementsAre("FAULTLINE_RUN plant", "FAULTLINE_RUN bank", "A 3", "A 4"));
  EXPECT_THAT(events("run-0003.lcm"),
              ElementsAre("FAULTLINE_RUN plant", "FAULTLINE_RUN bank", "A 5"));
}

TEST_F(RotatingLogTest, KeepsFilesAtMostAsLongAsAsked) {
  LogSplit split;
  split.bytes = 1000;
  const auto log = open_rotating_log(folder_ / "run.lcm", split);
  publish(*log, kRunChannel, 0, std::string(300, 'r'));
  for (int i = 0; i < 50; ++i) publish(*log, "A", i, std::string(71, 'a'));
  log->close();
  // 341 bytes of RUN and six messages of 100 bytes.
  EXPECT_EQ(files().size(), 9U);
  for (const std::string& name : files()) {
    EXPECT_LE(std::filesystem::file_size(folder_ / name), 1000U) << name;
    EXPECT_LE(events(name).size(), 7U);
  }
}

TEST_F(RotatingLogTest, PutsAMessageIntoEveryFileHoweverSmallItShallBe) {
  LogSplit split;
  split.bytes = 1;
  const auto log = open_rotating_log(folder_ / "run.lcm", split);
  publish(*log, kRunChannel, 0, "plant");
  publish(*log, "A", 0, "1");
  publish(*log, "A", 1, "2");
  log->close();
  EXPECT_THAT(files(), ElementsAre("run-0001.lcm", "run-0002.lcm"));
}

TEST_F(RotatingLogTest, DeletesOldFilesOnlyWhenAsked) {
  LogSplit split;
  split.time_us = 1;
  split.keep = 2;
  const auto log = open_rotating_log(folder_ / "run.lcm", split);
  for (int i = 0; i < 5; ++i) publish(*log, "A", 10 * i, "a");
  log->close();
  EXPECT_THAT(files(), ElementsAre("run-0004.lcm", "run-0005.lcm"));
}

TEST_F(RotatingLogTest, ReplacesAllFilesOfAnEarlierLogOfItsName) {
  const auto file = [&](const char* name) { open_log(folder_ / name)->close(); };
  for (const char* name : {"run-0001.lcm", "run-0017.lcm", "run-10000.lcm", "run-01.lcm",
                           "run-0001.log", "other-0001.lcm", "run.lcm"}) {
    file(name);
  }
  LogSplit split;
  split.time_us = 1;
  open_rotating_log(folder_ / "run.lcm", split)->close();
  EXPECT_THAT(files(), ElementsAre("other-0001.lcm", "run-0001.lcm", "run-0001.log", "run-01.lcm",
                                   "run.lcm"));
}

TEST_F(RotatingLogTest, LeavesFilesAloneThatAreNoLogs) {
  write("run-0002.lcm", "a diary");
  open_log(folder_ / "run-0001.lcm")->close();
  LogSplit split;
  split.time_us = 1;
  EXPECT_THROW(static_cast<void>(open_rotating_log(folder_ / "run.lcm", split)),
               std::invalid_argument);
  EXPECT_THAT(files(), ElementsAre("run-0001.lcm", "run-0002.lcm"));
}

TEST_F(RotatingLogTest, SaysWhenAFileCannotBeOpened) {
  LogSplit split;
  split.time_us = 1;
  EXPECT_THROW(static_cast<void>(open_rotating_log(folder_ / "none" / "run.lcm", split)),
               MessageSinkError);
}

}  // namespace
}  // namespace faultline
