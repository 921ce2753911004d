#include "diagnosis/bank/observer_text.h"

#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/bank/json_text.h"
#include "diagnosis/bank/json_tree.h"

namespace faultline {
namespace {

/// An object, one member per line.
class ObjectText {
 public:
  explicit ObjectText(int indent) : indent_(indent) {}

  void add(std::string_view key, std::string_view value) {
    text_ += fmt::format("{}\n{:{}}\"{}\": {}", text_.empty() ? "{" : ",", "", indent_, key, value);
  }
  void add(std::string_view key, const Eigen::MatrixXd& matrix) {
    // A matrix's second row stands under its first.
    add(key, matrix_text(matrix, indent_ + static_cast<int>(key.size()) + 5));
  }
  [[nodiscard]] std::string close() const {
    return fmt::format("{}\n{:{}}}}", text_, "", indent_ - 2);
  }

 private:
  int indent_;
  std::string text_;
};

std::string function_text(const NonlinearFunction& function) {
  std::string text = fmt::format("{{\"kind\": \"{}\"", function_name(function.kind));
  if (function.kind == FunctionKind::kDeadZone || function.kind == FunctionKind::kSaturation) {
    text += fmt::format(", \"width\": {}", json_number(function.width));
  } else if (function.kind == FunctionKind::kPolynomial) {
    text +=
        fmt::format(", \"coefficients\": {}, \"domain\": {}", number_list(function.coefficients),
                    number_list(std::vector{function.domain_min, function.domain_max}));
  } else if (function.kind == FunctionKind::kTable) {
    text += fmt::format(", \"at\": {}, \"value\": {}", number_list(function.at),
                        number_list(function.value));
  }
  return text + "}";
}

std::string nonlinearities_text(const std::vector<FilterNonlinearity>& nonlinearities) {
  std::vector<std::string> items;
  for (const FilterNonlinearity& term : nonlinearities) {
    ObjectText object(12);
    object.add("function", function_text(term.function));
    object.add("center", json_number(term.center));
    object.add("radius", json_number(term.radius));
    object.add("W", number_list(term.W));
    object.add("a_v", number_list(term.a_v));
    object.add("a_y", number_list(term.a_y));
    object.add("a_u", number_list(term.a_u));
    items.push_back(object.close());
  }
  return fmt::format("[{}]", fmt::join(items, ", "));
}

std::string course_text(const ThresholdCourse& course) {
  ObjectText object(10);
  object.add("weight", course.weight);
  object.add("norm", number_list(course.norm));
  object.add("component", course.component);
  return object.close();
}

std::string certificate_text(const Bank& bank, const ObserverCertificate& certificate) {
  ObjectText object(10);
  object.add("fault_states", name_list(names_of(bank.fault_names, certificate.fault_states)));
  object.add("drift_bound", number_list(certificate.drift_bound));
  object.add("T", certificate.T);
  object.add("gain", certificate.gain);
  object.add("alpha", json_number(certificate.alpha));
  object.add("P", certificate.P);
  object.add("mu_now", number_list(certificate.mu_now));
  object.add("mu_next", number_list(certificate.mu_next));
  object.add("mu_direct", number_list(certificate.mu_direct));
  object.add("beta", json_number(certificate.beta));
  object.add("detects", name_list(names_of(bank.fault_names, certificate.detects)));
  object.add("band_low_rad", json_number(certificate.band_low_rad));
  object.add("band_high_rad", json_number(certificate.band_high_rad));
  object.add("vertex_radius", number_list(certificate.vertex_radius));
  object.add("nominal_fault", number_list(certificate.nominal_fault));
  object.add("guaranteed_fault", number_list(certificate.guaranteed_fault));
  return object.close();
}

}  // namespace

bool is_observer(const ResidualFilter& filter) {
  return filter.transient_samples > 0 || !filter.nonlinearities.empty() ||
         filter.evaluation != Evaluation::kNorm || filter.course || filter.estimation ||
         filter.observer;
}

std::string observer_text(const Bank& bank, const ResidualFilter& filter) {
  ObjectText object(8);
  object.add("transient_samples", fmt::to_string(filter.transient_samples));
  object.add("nonlinearities", nonlinearities_text(filter.nonlinearities));
  object.add("evaluation",
             filter.evaluation == Evaluation::kComponent ? "\"component\"" : "\"norm\"");
  if (filter.course) object.add("course", course_text(*filter.course));
  if (filter.estimation) {
    object.add("estimation", fmt::format("{{\"fault\": {}, \"bound\": {}, \"settle_samples\": {}}}",
                                         json_string(bank.fault_names[filter.estimation->fault]),
                                         json_number(filter.estimation->bound),
                                         filter.estimation->settle_samples));
  }
  if (filter.observer) object.add("certificate", certificate_text(bank, *filter.observer));
  return object.close();
}

std::vector<std::string> names_of(const std::vector<std::string>& names,
                                  const std::vector<std::size_t>& indices) {
  std::vector<std::string> chosen;
  for (const std::size_t i : indices) {
    chosen.push_back(names[i]);
  }
  return chosen;
}

}  // namespace faultline
