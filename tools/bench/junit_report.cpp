#include "tools/bench/junit_report.h"

#include <algorithm>
#include <cstdint>

#include <fmt/format.h>

namespace faultline {
namespace {

constexpr std::string_view kReplacement = "\xEF\xBF\xBD";  // U+FFFD

/// A character in UTF-8: its number and length; length 0: no valid one.
struct Utf8Character {
  std::uint32_t number = 0;
  std::size_t length = 0;
};

Utf8Character read_utf8(std::string_view text) {
  const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(text[i]); };
  const std::uint8_t first = byte(0);
  if (first < 0x80) return {first, 1};
  const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
  if (first < 0xC2 || first > 0xF4 || text.size() < length) return {};
  std::uint32_t number = first & (0x7FU >> length);
  for (std::size_t i = 1; i < length; ++i) {
    if ((byte(i) & 0xC0U) != 0x80U) return {};
    number = number << 6U | (byte(i) & 0x3FU);
  }
  constexpr std::uint32_t kSmallest[] = {0x80, 0x800, 0x10000};
  return number >= kSmallest[length - 2] ? Utf8Character{number, length} : Utf8Character{};
}

/// Char of XML 1.0.
bool is_xml(std::uint32_t number) {
  return number == 0x9 || number == 0xA || number == 0xD || (number >= 0x20 && number <= 0xD7FF) ||
         (number >= 0xE000 && number <= 0xFFFD) || (number >= 0x10000 && number <= 0x10FFFF);
}

std::string escaped(char character) {
  switch (character) {
    case '&':
      return "&amp;";
    case '<':
      return "&lt;";
    case '>':
      return "&gt;";
    case '"':
      return "&quot;";
    case '\n':  // as it is, an attribute would make a space of it
      return "&#10;";
    case '\t':
      return "&#9;";
    case '\r':
      return "&#13;";
    default:
      return {character};
  }
}

struct TestCase {
  std::string name;
  std::string body;  ///< elements, indented; empty: it passed
};

struct TestSuite {
  const ScenarioOutcome* outcome = nullptr;
  std::vector<TestCase> cases;
  std::size_t failures = 0, errors = 0, skipped = 0;
};

std::string element(std::string_view tag, std::string_view type, const std::string& text) {
  return fmt::format("      <{0} type=\"{1}\" message=\"{2}\">{2}</{0}>\n", tag, type,
                     xml_escaped(text));
}

void add_expectations(TestSuite& suite) {
  for (const DecidedExpectation& expectation : decided_expectations(*suite.outcome)) {
    TestCase test{expectation_words(expectation.outcome.expectation), {}};
    if (!expectation.is_decided) {
      ++suite.skipped;
      test.body = "      <skipped message=\"the run ended before\"/>\n";
    } else if (!expectation.is_met()) {
      ++suite.failures;
      test.body = element("failure", "expectation", expectation.outcome.found);
    }
    suite.cases.push_back(std::move(test));
  }
}

TestSuite suite_of(const ScenarioOutcome& outcome) {
  TestSuite suite{.outcome = &outcome};
  add_expectations(suite);
  if (!outcome.error.empty()) {
    ++suite.errors;
    const char* const type = outcome.result ? "stopped" : "not_run";
    suite.cases.push_back({"run", element("error", type, outcome.error)});
  } else if (suite.cases.empty()) {
    suite.cases.push_back({"run", {}});
  }
  return suite;
}

std::string xml_of(const TestSuite& suite) {
  const ScenarioOutcome& outcome = *suite.outcome;
  const std::string name = xml_escaped(outcome.name);
  std::string xml = fmt::format(
      "  <testsuite name=\"{}\" file=\"{}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" "
      "skipped=\"{}\" time=\"{:.3f}\">\n",
      name, xml_escaped(outcome.file.string()), suite.cases.size(), suite.failures, suite.errors,
      suite.skipped, outcome.wall_s);
  const double time_s = outcome.wall_s / static_cast<double>(suite.cases.size());
  for (const TestCase& test : suite.cases) {
    xml += fmt::format("    <testcase name=\"{}\" classname=\"{}\" time=\"{:.3f}\"",
                       xml_escaped(test.name), name, time_s);
    xml += test.body.empty() ? "/>\n" : ">\n" + test.body + "    </testcase>\n";
  }
  return xml + "  </testsuite>\n";
}

}  // namespace

std::string xml_escaped(std::string_view text) {
  std::string xml;
  while (!text.empty()) {
    const Utf8Character character = read_utf8(text);
    if (character.length == 0 || !is_xml(character.number)) {
      xml += kReplacement;
    } else if (character.length == 1) {
      xml += escaped(text.front());
    } else {
      xml += text.substr(0, character.length);
    }
    text.remove_prefix(std::max<std::size_t>(character.length, 1));
  }
  return xml;
}

std::string junit_xml(const std::vector<ScenarioOutcome>& outcomes) {
  std::string suites;
  TestSuite sum;
  std::size_t tests = 0;
  double time_s = 0.0;
  for (const ScenarioOutcome& outcome : outcomes) {
    const TestSuite suite = suite_of(outcome);
    tests += suite.cases.size();
    sum.failures += suite.failures;
    sum.errors += suite.errors;
    sum.skipped += suite.skipped;
    time_s += outcome.wall_s;
    suites += xml_of(suite);
  }
  return fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"faultline\" tests=\"{}\" "
      "failures=\"{}\" errors=\"{}\" skipped=\"{}\" time=\"{:.3f}\">\n{}</testsuites>\n",
      tests, sum.failures, sum.errors, sum.skipped, time_s, suites);
}

}  // namespace faultline
