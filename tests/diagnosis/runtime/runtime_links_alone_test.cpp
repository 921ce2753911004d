// Reads a golden bank and replays a golden log with the run time alone: this program links
// faultline::diagnosis_runtime and no design code. See tests/golden/geometric/README.md.

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/bank/bank_file.h"
#include "diagnosis/runtime/decision.h"
#include "diagnosis/runtime/evaluator.h"
#include "diagnosis/runtime/residual_bank.h"

namespace faultline {
namespace {

const std::string kGolden = std::string(FAULTLINE_GOLDEN_DIR) + "/geometric/";

/// One line of hexadecimal doubles.
std::vector<double> read_doubles(const std::string& line) {
  std::istringstream words(line);
  std::vector<double> values;
  for (std::string word; words >> word;) {
    values.push_back(std::strtod(word.c_str(), nullptr));
  }
  return values;
}

TEST(Runtime, ReplaysTheGoldenLogToTheBit) {
  const Bank bank = read_bank(kGolden + "replay.bank.json");
  const std::size_t q = bank.output_names.size();
  const std::size_t m = bank.input_names.size();
  ResidualBank filters(bank);
  const std::size_t rows = filters.residual().size();
  std::ifstream log(kGolden + "replay_log.txt");
  int k = 0;
  for (std::string line; std::getline(log, line); ++k) {
    const std::vector<double> values = read_doubles(line);
    ASSERT_EQ(values.size(), q + m + rows + bank.filters.size());
    const double* at = values.data();
    filters.step({at, q}, {at + q, m});
    at += q + m;
    for (std::size_t i = 0; i < rows; ++i) {
      ASSERT_EQ(filters.residual()[i], *at++) << "residual row " << i << " of sample " << k;
    }
    for (std::size_t i = 0; i < bank.filters.size(); ++i) {
      ASSERT_EQ(filters.evaluation()[i], *at++) << bank.filters[i].name << " of sample " << k;
    }
  }
  EXPECT_EQ(k, 200);
}

TEST(Runtime, EvaluatesAndDecidesWithoutTheDesign) {
  const Bank bank = read_bank(kGolden + "replay.bank.json");
  Evaluator evaluator(bank);
  const DecisionTable table(bank);
  evaluator.step(std::vector<double>(bank.filters.size(), 0.0), ResidualBank(bank).thresholds());
  EXPECT_EQ(table.decide(evaluator.signature()).verdict, Verdict::kHealthy);
}

}  // namespace
}  // namespace faultline
