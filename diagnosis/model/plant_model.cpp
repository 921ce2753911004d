#include "diagnosis/model/plant_model.h"

#include <fmt/format.h>

#include "diagnosis/model/digest.h"

namespace faultline {
namespace {

// One line per item, every number with 17 significant digits (which identify a double) and every
// word with its length, so that different models never give the same text.
class CanonicalText {
 public:
  void word(const std::string& value) { text_ += fmt::format("{}:{}\n", value.size(), value); }
  void words(const std::vector<std::string>& values) {
    text_ += fmt::format("{}\n", values.size());
    for (const std::string& value : values) {
      word(value);
    }
  }
  void number(double value) {
    // -0 and 0 are the same number.
    text_ += fmt::format("{:.17g}\n", value == 0.0 ? 0.0 : value);
  }
  void optional_number(const std::optional<double>& value) {
    if (value) {
      number(*value);
    } else {
      text_ += "none\n";
    }
  }
  void matrix(const Eigen::MatrixXd& values) {
    text_ += fmt::format("{}x{}\n", values.rows(), values.cols());
    for (Eigen::Index i = 0; i < values.rows(); ++i) {
      for (Eigen::Index j = 0; j < values.cols(); ++j) {
        number(values(i, j));
      }
    }
  }
  void count(std::size_t value) { text_ += fmt::format("{}\n", value); }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string text_;
};

void add_channels(CanonicalText& text, const PlantModel& model) {
  text.words(model.state_names);
  text.words(model.input_names);
  text.words(model.output_names);
  text.matrix(model.input_range);
  text.matrix(model.output_range);
  if (model.state_range) {
    text.word("state_range");
    text.matrix(*model.state_range);
  }
}

void add_faults(CanonicalText& text, const PlantModel& model) {
  text.count(model.faults.size());
  for (const Fault& fault : model.faults) {
    text.word(fault.name);
    text.count(static_cast<std::size_t>(fault.kind));
    text.matrix(fault.state);
    text.matrix(fault.output);
    text.number(fault.size);
  }
}

void add_unknown_inputs(CanonicalText& text, const PlantModel& model) {
  text.count(model.disturbances.size());
  for (const Disturbance& disturbance : model.disturbances) {
    text.word(disturbance.name);
    text.matrix(disturbance.state);
    text.matrix(disturbance.output);
    text.optional_number(disturbance.bound);
  }
  text.count(model.noises.size());
  for (const Noise& noise : model.noises) {
    text.matrix(noise.output);
    text.optional_number(noise.bound);
    text.optional_number(noise.sigma);
  }
}

void add_function(CanonicalText& text, const NonlinearFunction& function) {
  text.word(function_name(function.kind));
  for (const double number : {function.width, function.domain_min, function.domain_max}) {
    text.number(number);
  }
  for (const std::vector<double>* numbers :
       {&function.coefficients, &function.at, &function.value}) {
    text.count(numbers->size());
    for (const double number : *numbers) {
      text.number(number);
    }
  }
}

void add_nonlinearities(CanonicalText& text, const PlantModel& model) {
  text.count(model.nonlinearities.size());
  for (const Nonlinearity& nonlinearity : model.nonlinearities) {
    add_function(text, nonlinearity.function);
    text.number(nonlinearity.gain);
    text.matrix(nonlinearity.E_o);
    text.matrix(nonlinearity.E_i);
    text.number(nonlinearity.slope_min);
    text.number(nonlinearity.slope_max);
  }
}

// A plant without any keeps the digest that it always had.
void add_uncertainties(CanonicalText& text, const PlantModel& model) {
  for (const Uncertainty& uncertainty : model.uncertainties) {
    text.word(uncertainty.name);
    text.word(uncertainty.is_parameter ? "parameter" : "plants");
    text.count(uncertainty.delta_A.size());
    for (std::size_t i = 0; i < uncertainty.delta_A.size(); ++i) {
      text.matrix(uncertainty.delta_A[i]);
      text.matrix(uncertainty.delta_B[i]);
    }
  }
}

}  // namespace

std::vector<std::string> PlantModel::fault_names() const {
  std::vector<std::string> names;
  names.reserve(faults.size());
  for (const Fault& fault : faults) {
    names.push_back(fault.name);
  }
  return names;
}

PlantModel with_rounded_outputs(const PlantModel& model, const Eigen::VectorXd& resolution) {
  PlantModel rounded = model;
  for (Eigen::Index i = 0; i < resolution.size(); ++i) {
    if (resolution[i] <= 0.0) continue;
    rounded.noises.push_back(
        {.name = "rounding of " + model.output_names[static_cast<std::size_t>(i)],
         .output = Eigen::VectorXd::Unit(model.q(), i),
         .bound = 0.5 * resolution[i],
         .sigma = {}});
  }
  return rounded;
}

std::string plant_digest(const PlantModel& model) {
  CanonicalText text;
  text.word(model.name);
  text.word(model.time == TimeDomain::kContinuous ? "continuous" : "discrete");
  text.optional_number(model.sample_time_s);
  add_channels(text, model);
  for (const Eigen::MatrixXd* matrix : {&model.A, &model.B, &model.C, &model.D}) {
    text.matrix(*matrix);
  }
  add_faults(text, model);
  add_unknown_inputs(text, model);
  add_nonlinearities(text, model);
  for (const Eigen::VectorXd* vector :
       {&model.x_operating, &model.u_operating, &model.y_operating}) {
    text.matrix(*vector);
  }
  add_uncertainties(text, model);
  return text_digest(text.text());
}

}  // namespace faultline
