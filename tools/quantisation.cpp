#include "tools/quantisation.h"

#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/certify/residual_evaluation.h"
#include "diagnosis/certify/sample_error.h"
#include "drivers/dbc/dbc_parser.h"
#include "drivers/signal/signal_map.h"

namespace faultline {
namespace {

std::string signal_name(const Bank& bank, std::size_t i) {
  const std::size_t q = bank.output_names.size();
  return i < q ? bank.output_names[i] : bank.input_names[i - q];
}

}  // namespace

std::vector<QuantisationError> quantisation_errors(const Bank& bank,
                                                   const std::filesystem::path& dbc) {
  const SignalMap map = make_signal_map(read_dbc(dbc), bank.output_names, bank.input_names);
  std::vector<QuantisationError> errors;
  for (const ResidualFilter& filter : bank.filters) {
    const SampleErrorGain gain = sample_error_gain(filter);
    const ResidualEvaluation evaluation(filter);
    QuantisationError error{filter.name, evaluation.threshold(), 0.0, {}};
    Eigen::VectorXd total = Eigen::VectorXd::Zero(filter.H.rows());
    const auto add = [&](const Eigen::MatrixXd& of, const std::vector<double>& resolution) {
      for (std::size_t i = 0; i < resolution.size(); ++i) {
        const Eigen::VectorXd share = 0.5 * resolution[i] * of.col(static_cast<Eigen::Index>(i));
        error.per_signal.push_back(evaluation.largest(share));
        total += share;
      }
    };
    add(gain.output, map.output_resolution);
    add(gain.input, map.input_resolution);
    error.total = evaluation.largest(total);
    errors.push_back(std::move(error));
  }
  return errors;
}

void print_quantisation(std::FILE* out, const Bank& bank,
                        const std::vector<QuantisationError>& errors) {
  fmt::print(out, "\n  rounding on the bus (half an LSB of every signal, worst order)\n");
  bool is_any_much = false;
  for (const QuantisationError& error : errors) {
    const auto worst = std::max_element(error.per_signal.begin(), error.per_signal.end());
    const double part = error.total / error.threshold;
    const bool is_much = part > kMuchQuantisation;
    is_any_much = is_any_much || is_much;
    fmt::print(out, "  {:<8} {:.2g}, {:.2g} % of its threshold", error.residual, error.total,
               100.0 * part);
    if (worst != error.per_signal.end() && *worst > 0.0) {
      fmt::print(out, "; most from {}",
                 signal_name(bank, static_cast<std::size_t>(worst - error.per_signal.begin())));
    }
    fmt::print(out, "{}\n", is_much ? "   WARNING" : "");
  }
  if (is_any_much) {
    fmt::print(out,
               "  WARNING  rounding may use up more than {:.0f} % of a threshold: give the signals "
               "named a finer\n           factor, choose slower poles, or raise the threshold\n",
               100.0 * kMuchQuantisation);
  }
}

nlohmann::ordered_json quantisation_json(const Bank& bank,
                                         const std::vector<QuantisationError>& errors) {
  using Json = nlohmann::ordered_json;
  Json json = Json::array();
  for (const QuantisationError& error : errors) {
    Json signals = Json::object();
    for (std::size_t i = 0; i < error.per_signal.size(); ++i) {
      signals[signal_name(bank, i)] = error.per_signal[i];
    }
    json.push_back({{"residual", error.residual},
                    {"error", error.total},
                    {"part_of_threshold", error.total / error.threshold},
                    {"warning", error.total > kMuchQuantisation * error.threshold},
                    {"signals", signals}});
  }
  return json;
}

}  // namespace faultline
