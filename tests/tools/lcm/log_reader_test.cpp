#include "tools/lcm/log_reader.h"

#include <array>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <vector>

#include <unistd.h>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lcm/lcm-cpp.hpp>

#include "tests/support/random_seed.h"

namespace faultline {
namespace {

using ::testing::ElementsAre;
using ::testing::ElementsAreArray;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// An event as a value.
struct Event {
  std::int64_t number = 0, utime = 0;
  std::string channel, data;

  friend bool operator==(const Event&, const Event&) = default;
  friend void PrintTo(const Event& event, std::ostream* out) {
    *out << fmt::format("#{} at {} on {}: {} bytes", event.number, event.utime, event.channel,
                        event.data.size());
  }
};

Event copy_of(const LogEvent& event) {
  return {event.number,
          event.utime,
          std::string(event.channel),
          {event.data.begin(), event.data.end()}};
}

class LogReaderTest : public ::testing::Test {
 protected:
  LogReaderTest() {
    std::string name = (std::filesystem::temp_directory_path() / "log_reader_test.XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("mkdtemp");
    folder_ = name;
  }
  ~LogReaderTest() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::filesystem::path file() const { return folder_ / "test.lcm"; }

  /// The bytes that liblcm writes for events on these channels.
  std::string written(const std::vector<std::pair<std::string, std::string>>& messages) {
    {
      lcm::LogFile log(file().string(), "w");
      std::int64_t utime = 1'700'000'000'000'000;
      for (const auto& [channel, data] : messages) {
        lcm::LogEvent event{};
        event.timestamp = utime += 1000;
        event.channel = channel;
        event.datalen = static_cast<std::int32_t>(data.size());
        std::string bytes = data;
        event.data = bytes.data();
        EXPECT_EQ(log.writeEvent(&event), 0);
      }
    }
    std::ifstream in(file(), std::ios::binary);
    return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  }

  void write(const std::string& bytes) const {
    std::ofstream(file(), std::ios::binary)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  }

  struct Reading {
    std::vector<Event> events;
    std::vector<LogDamage> damages;
  };

  /// Every byte is in an event or in a damage, once, and in order.
  [[nodiscard]] Reading read() const {
    LogReader reader(file());
    Reading reading;
    std::uint64_t at = 0;
    std::size_t damage = 0;
    const auto pass_damages = [&] {
      for (; damage < reader.damages().size(); ++damage) {
        EXPECT_EQ(reader.damages()[damage].offset, at);
        EXPECT_GT(reader.damages()[damage].bytes, 0U);
        at += reader.damages()[damage].bytes;
      }
    };
    while (const LogEvent* event = reader.next()) {
      pass_damages();
      EXPECT_EQ(event->offset, at);
      EXPECT_EQ(event->bytes.size(), 28 + event->channel.size() + event->data.size());
      at += event->bytes.size();
      reading.events.push_back(copy_of(*event));
    }
    pass_damages();
    EXPECT_EQ(at, std::filesystem::file_size(file()));
    EXPECT_EQ(reader.next(), nullptr);
    reading.damages = reader.damages();
    return reading;
  }
  [[nodiscard]] Reading read(const std::string& bytes) const {
    write(bytes);
    return read();
  }

  /// What liblcm's own reader makes of the file.
  [[nodiscard]] std::vector<Event> read_with_liblcm() const {
    lcm::LogFile log(file().string(), "r");
    std::vector<Event> events;
    while (const lcm::LogEvent* event = log.readNextEvent()) {
      events.push_back(
          {event->eventnum,
           event->timestamp,
           event->channel,
           {static_cast<const char*>(event->data), static_cast<std::size_t>(event->datalen)}});
    }
    return events;
  }

  std::filesystem::path folder_;
};

/// A small log: its events, its bytes, and where its events begin (and the end).
struct SmallLog {
  std::string bytes;
  std::vector<Event> events;
  std::vector<std::size_t> begins;
};

class DamagedLog : public LogReaderTest {
 protected:
  DamagedLog() {
    log_.bytes = written({{"A", "alpha"},
                          {"FAULTLINE_SAMPLE", std::string(40, '\0')},
                          {"B", ""},
                          {"CHANNEL", "payload payload"},
                          {"E", std::string("\xED\xA1\xDA", 3)}});
    LogReader reader(file());
    while (const LogEvent* event = reader.next()) {
      log_.begins.push_back(event->offset);
      log_.events.push_back(copy_of(*event));
    }
    log_.begins.push_back(log_.bytes.size());
  }

  /// Index of the event that byte `at` belongs to.
  [[nodiscard]] std::size_t event_at(std::size_t at) const {
    std::size_t index = 0;
    while (log_.begins[index + 1] <= at) ++index;
    return index;
  }
  /// The events but for `index`.
  [[nodiscard]] std::vector<Event> without(std::size_t index) const {
    std::vector<Event> events = log_.events;
    events.erase(events.begin() + static_cast<std::ptrdiff_t>(index));
    return events;
  }

  SmallLog log_;
};

TEST_F(LogReaderTest, ReadsWhatLiblcmWroteAsLiblcmReadsIt) {
  std::mt19937_64 random(test_seed(20261122));
  SCOPED_TRACE(seed_message(test_seed(20261122)));
  std::vector<std::pair<std::string, std::string>> messages;
  for (int i = 0; i < 3000; ++i) {
    std::string data(random() % (i % 100 == 0 ? 300'000 : 400), '\0');
    for (char& byte : data) byte = static_cast<char>(random());
    messages.emplace_back(std::string(1 + random() % 62, 'c'), data);
  }
  written(messages);
  const Reading reading = read();
  EXPECT_TRUE(reading.events == read_with_liblcm());
  EXPECT_THAT(reading.events, SizeIs(3000));
  EXPECT_THAT(reading.damages, IsEmpty());
}

TEST_F(LogReaderTest, ReadsEventsLongerThanItsBuffer) {
  std::string large(5 << 20, 'x');
  large.replace(1 << 20, 4, kLogMagic);
  written({{"LARGE", large}, {"SMALL", "s"}, {"LARGE", large}});
  const Reading reading = read();
  EXPECT_TRUE(reading.events == read_with_liblcm());
  EXPECT_THAT(reading.damages, IsEmpty());
}

TEST_F(LogReaderTest, TakesAMagicInAPayloadForPayload) {
  written({{"A", std::string(kLogMagic) + std::string(100, '\0')}, {"B", "b"}});
  const Reading reading = read();
  EXPECT_TRUE(reading.events == read_with_liblcm());
  EXPECT_THAT(reading.damages, IsEmpty());
}

TEST_F(LogReaderTest, TakesALogInAPayloadForPayload) {
  const std::string inner = written({{"INNER", "one"}, {"INNER", "two"}});
  written({{"OUTER", inner}, {"OUTER", inner}, {"LAST", ""}});
  const Reading reading = read();
  EXPECT_TRUE(reading.events == read_with_liblcm());
  EXPECT_THAT(reading.damages, IsEmpty());
}

TEST_F(LogReaderTest, RefusesWhatIsNoLog) {
  const auto message_of = [this](const std::string& bytes) {
    write(bytes);
    try {
      LogReader reader(file());
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_THAT(message_of(""), HasSubstr("found no LCM event (it is empty), expected an LCM log"));
  EXPECT_THAT(message_of("schema = 1\n"), HasSubstr("found no LCM event at its start"));
  EXPECT_THAT(message_of(std::string(3 << 20, '\xED')), HasSubstr("expected an LCM log"));
  EXPECT_THROW(LogReader(folder_ / "none.lcm"), std::system_error);
  EXPECT_THROW(LogReader{folder_}, std::system_error);
}

TEST_F(LogReaderTest, FollowsAGrowingFile) {
  const std::string bytes = written({{"A", "alpha"}, {"B", "beta"}, {"C", "gamma"}});
  const std::vector<Event> expected = read().events;
  // Nothing behind the first event can be in the buffer.
  write(bytes.substr(0, 34));
  LogReader reader(file());
  std::ofstream(file(), std::ios::binary | std::ios::app) << bytes.substr(34, 20);
  const LogEvent* first = reader.next();
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(copy_of(*first), expected[0]);
  EXPECT_LE(reader.size().value(), bytes.size());
}

TEST_F(LogReaderTest, ReadsAPipeThatComesInPieces) {
  const std::string bytes = written({{"A", "alpha"}, {"B", std::string(200'000, 'b')}, {"C", ""}});
  const std::vector<Event> expected = read().events;
  const std::filesystem::path fifo = folder_ / "fifo";
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe(ends.data()), 0);
  std::thread writer([&] {
    for (std::size_t at = 0; at < bytes.size(); at += 777) {
      const std::size_t count = std::min<std::size_t>(777, bytes.size() - at);
      if (::write(ends[1], bytes.data() + at, count) != static_cast<ssize_t>(count)) break;
    }
    ::close(ends[1]);
  });
  std::vector<Event> events;
  {
    LogReader reader(fmt::format("/dev/fd/{}", ends[0]));
    EXPECT_EQ(reader.size(), std::nullopt);
    while (const LogEvent* event = reader.next()) events.push_back(copy_of(*event));
    EXPECT_THAT(reader.damages(), IsEmpty());
  }
  writer.join();
  ::close(ends[0]);
  EXPECT_THAT(events, ElementsAreArray(expected));
}

TEST_F(DamagedLog, TruncatedAnywhereLosesOnlyTheEventThatIsCut) {
  for (std::size_t size = 4; size < log_.bytes.size(); ++size) {
    SCOPED_TRACE(size);
    const Reading reading = read(log_.bytes.substr(0, size));
    const std::size_t whole = event_at(size);
    EXPECT_THAT(reading.events,
                ElementsAreArray(log_.events.begin(),
                                 log_.events.begin() + static_cast<std::ptrdiff_t>(whole)));
    if (size == log_.begins[whole]) {
      EXPECT_THAT(reading.damages, IsEmpty());
    } else {
      ASSERT_THAT(reading.damages, SizeIs(1));
      EXPECT_EQ(reading.damages[0].offset, log_.begins[whole]);
      EXPECT_TRUE(reading.damages[0].is_end);
    }
  }
}

TEST_F(DamagedLog, AChangedBitLosesAtMostItsOwnEvent) {
  for (std::size_t at = 0; at < log_.bytes.size(); ++at) {
    for (const int bit : {0, 3, 7}) {
      SCOPED_TRACE(fmt::format("byte {}, bit {}", at, bit));
      std::string bytes = log_.bytes;
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << bit));
      const Reading reading = read(bytes);
      const std::size_t own = event_at(at);
      std::vector<Event> found = reading.events;
      const std::vector<Event> others = without(own);
      // The others are all there; its own is there too, changed, where its lengths still hold.
      ASSERT_GE(found.size(), others.size());
      if (found.size() > others.size())
        found.erase(found.begin() + static_cast<std::ptrdiff_t>(own));
      EXPECT_THAT(found, ElementsAreArray(others));
    }
  }
}

TEST_F(DamagedLog, RemovedBytesLoseAtMostTheEventsTheyBelongTo) {
  for (std::size_t at = 0; at < log_.bytes.size(); ++at) {
    for (const std::size_t count : {1U, 3U, 20U, 60U}) {
      if (at + count > log_.bytes.size()) continue;
      SCOPED_TRACE(fmt::format("{} bytes at {}", count, at));
      std::string bytes = log_.bytes;
      bytes.erase(at, count);
      const std::size_t first = event_at(at);
      const std::size_t last = event_at(at + count - 1);
      std::vector<Event> expected(log_.events.begin(),
                                  log_.events.begin() + static_cast<std::ptrdiff_t>(first));
      expected.insert(expected.end(), log_.events.begin() + static_cast<std::ptrdiff_t>(last) + 1,
                      log_.events.end());
      const Reading reading = read(bytes);
      const bool is_clean_cut = at == log_.begins[first] && at + count == log_.begins[last + 1];
      if (is_clean_cut) {
        EXPECT_THAT(reading.events, ElementsAreArray(expected));
        EXPECT_THAT(reading.damages, IsEmpty());
        continue;
      }
      EXPECT_THAT(reading.events, ::testing::IsSupersetOf(expected));
      EXPECT_LE(reading.events.size(), expected.size() + 1);
    }
  }
}

TEST_F(DamagedLog, InsertedBytesLoseAtMostTheEventTheyAreIn) {
  // No "x": in a length it happens to lead to another event, and nobody could tell.
  const std::vector<std::string> garbages = {"y", "garbage garbage garbage garbage",
                                             std::string(kLogMagic), std::string(200, '\xED'),
                                             std::string(100, '\0')};
  for (std::size_t at = 0; at <= log_.bytes.size(); ++at) {
    for (const std::string& garbage : garbages) {
      SCOPED_TRACE(fmt::format("{} bytes at {}", garbage.size(), at));
      std::string bytes = log_.bytes;
      bytes.insert(at, garbage);
      const Reading reading = read(bytes);
      const std::size_t own = at == log_.bytes.size() ? log_.events.size() : event_at(at);
      const bool is_between =
          std::find(log_.begins.begin(), log_.begins.end(), at) != log_.begins.end();
      const auto expected = is_between ? log_.events : without(own);
      EXPECT_THAT(reading.events, ::testing::IsSupersetOf(expected));
      EXPECT_LE(reading.events.size(), expected.size() + 1);
      if (is_between) {
        EXPECT_THAT(reading.events, ElementsAreArray(log_.events));
        EXPECT_THAT(reading.damages, SizeIs(1));
      }
    }
  }
}

TEST_F(DamagedLog, FindsAnEventBetweenTwoDamages) {
  std::string bytes;
  for (std::size_t i = 0; i < log_.events.size(); ++i) {
    bytes += log_.bytes.substr(log_.begins[i], log_.begins[i + 1] - log_.begins[i]);
    bytes += "damage";
  }
  const Reading reading = read("damage" + bytes);
  EXPECT_THAT(reading.events, ElementsAreArray(log_.events));
  EXPECT_THAT(reading.damages, SizeIs(log_.events.size() + 1));
}

TEST_F(DamagedLog, FindsTheNextEventBehindDamageLongerThanItsBuffer) {
  std::string garbage(3 << 20, 'g');
  for (std::size_t at = 0; at < garbage.size(); at += 1000) garbage.replace(at, 4, kLogMagic);
  const std::string bytes =
      log_.bytes.substr(0, log_.begins[2]) + garbage + log_.bytes.substr(log_.begins[2]);
  const Reading reading = read(bytes);
  EXPECT_THAT(reading.events, ElementsAreArray(log_.events));
  ASSERT_THAT(reading.damages, SizeIs(1));
  EXPECT_EQ(reading.damages[0].bytes, garbage.size());
}

/// The header of an event with these lengths.
std::string header_with(std::uint32_t channel_bytes, std::uint32_t data_bytes) {
  std::string header(kLogMagic);
  header.append(16, '\0');
  for (const std::uint32_t length : {channel_bytes, data_bytes}) {
    for (int shift = 24; shift >= 0; shift -= 8) header += static_cast<char>(length >> shift);
  }
  return header;
}

TEST_F(DamagedLog, IsNotFooledByLengthsThatLie) {
  for (const auto& [channel_bytes, data_bytes] :
       std::vector<std::pair<std::uint32_t, std::uint32_t>>{{0, 0},
                                                            {0, 10},
                                                            {1, 0xFFFF'FFFF},
                                                            {0xFFFF'FFFF, 1},
                                                            {0x8000'0000, 0x8000'0000},
                                                            {1, 0x7FFF'FFFF},
                                                            {0x7FFF'FFFF, 0x7FFF'FFFF},
                                                            {5, 60'000'000},
                                                            {255, 100},
                                                            {256, 0}}) {
    SCOPED_TRACE(fmt::format("{} {}", channel_bytes, data_bytes));
    const Reading reading = read(header_with(channel_bytes, data_bytes) + log_.bytes);
    EXPECT_THAT(reading.events, ElementsAreArray(log_.events));
    ASSERT_THAT(reading.damages, SizeIs(1));
    EXPECT_EQ(reading.damages[0].bytes, 28U);
  }
}

/// Magics with large lengths, each of which could lead anywhere: a reader that looked again at what
/// one of them spans would take hours.
TEST_F(DamagedLog, ReadsAHostileFileInOneGo) {
  std::string bytes;
  while (bytes.size() < 8U << 20) {
    bytes += header_with(1, static_cast<std::uint32_t>((4U << 20) + bytes.size() % 4099));
    bytes += "cccc";
  }
  const std::string whole = bytes + log_.bytes;
  const Reading reading = read(whole);
  ASSERT_GE(reading.events.size(), log_.events.size());
  const std::vector<Event> last(
      reading.events.end() - static_cast<std::ptrdiff_t>(log_.events.size()), reading.events.end());
  EXPECT_THAT(last, ElementsAreArray(log_.events));
}

}  // namespace
}  // namespace faultline
