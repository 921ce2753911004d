#pragma once

#include <string>
#include <vector>

#include <Eigen/Core>

namespace faultline {

// Lists as JSON text. Private to diagnosis/bank.

/// Strings, quoted, on one line.
[[nodiscard]] std::string name_list(const std::vector<std::string>& names);

/// Numbers on one line. Precondition: finite.
[[nodiscard]] std::string number_list(const std::vector<double>& numbers);
[[nodiscard]] std::string number_list(const Eigen::VectorXd& numbers);

/// Rows of numbers, one per line; all but the first at `indent` spaces.
[[nodiscard]] std::string matrix_text(const Eigen::MatrixXd& matrix, int indent);

}  // namespace faultline
