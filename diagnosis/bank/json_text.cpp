#include "diagnosis/bank/json_text.h"

#include <cassert>
#include <cmath>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/bank/json_tree.h"

namespace faultline {
namespace {

template <class Numbers>
std::string list_of(const Numbers& numbers) {
  std::vector<std::string> texts;
  for (const double number : numbers) {
    assert(std::isfinite(number));
    texts.push_back(json_number(number));
  }
  return fmt::format("[{}]", fmt::join(texts, ", "));
}

}  // namespace

std::string name_list(const std::vector<std::string>& names) {
  std::vector<std::string> quoted;
  for (const std::string& name : names) {
    quoted.push_back(json_string(name));
  }
  return fmt::format("[{}]", fmt::join(quoted, ", "));
}

std::string number_list(const std::vector<double>& numbers) { return list_of(numbers); }
std::string number_list(const Eigen::VectorXd& numbers) { return list_of(numbers); }

std::string matrix_text(const Eigen::MatrixXd& matrix, int indent) {
  std::vector<std::string> rows;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i) {
    rows.push_back(number_list(Eigen::VectorXd(matrix.row(i))));
  }
  return fmt::format("[{}]", fmt::join(rows, fmt::format(",\n{:{}}", "", indent)));
}

}  // namespace faultline
