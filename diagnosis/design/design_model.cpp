#include "diagnosis/design/design_model.h"

#include <algorithm>
#include <optional>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include "diagnosis/design/with_rows.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

Directions fault_directions(const PlantModel& plant) {
  const auto count = std::ssize(plant.faults);
  Directions directions{MatrixXd(plant.n(), count), MatrixXd(plant.q(), count)};
  Index j = 0;
  for (const Fault& fault : plant.faults) {
    directions.state.col(j) = fault.state;
    directions.output.col(j++) = fault.output;
  }
  return directions;
}

// Directions of the disturbances that `key` of the request names.
Directions named_disturbances(const PlantModel& plant, const BankRequest& request,
                              std::string_view key, const std::vector<std::string>& asked) {
  const auto count = std::ssize(asked);
  Directions directions{MatrixXd(plant.n(), count), MatrixXd(plant.q(), count)};
  std::vector<std::string> names;
  for (const Disturbance& disturbance : plant.disturbances) {
    names.push_back(disturbance.name);
  }
  for (Index j = 0; j < count; ++j) {
    const std::string& name = asked[static_cast<std::size_t>(j)];
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) {
      const std::optional<std::string> near = nearest_name(name, names);
      throw request_error(
          request, key,
          fmt::format("found \"{}\", expected names of the plant's disturbances{}", name,
                      near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    std::ptrdiff_t times = 0;
    for (const auto* list :
         {&request.decouple, &request.decouple_constant, &request.eigenstructure.weaken}) {
      times += std::count(list->begin(), list->end(), name);
    }
    if (times > 1) {
      throw request_error(request, key, fmt::format("found \"{}\" twice, expected it once", name));
    }
    const Disturbance& disturbance =
        plant.disturbances[static_cast<std::size_t>(found - names.begin())];
    directions.state.col(j) = disturbance.state;
    directions.output.col(j) = disturbance.output;
  }
  return directions;
}

Directions weakened_disturbances(const PlantModel& plant, const BankRequest& request) {
  const std::vector<std::string>& names = request.eigenstructure.weaken;
  Directions directions = named_disturbances(plant, request, "eigenstructure", names);
  for (Index i = 0; i < directions.state.cols(); ++i) {
    for (const Disturbance& disturbance : plant.disturbances) {
      if (disturbance.name == names[static_cast<std::size_t>(i)]) {
        directions.state.col(i) *= disturbance.bound.value_or(1.0);
        directions.output.col(i) *= disturbance.bound.value_or(1.0);
      }
    }
  }
  return directions;
}

// All inputs of the sampled plant are held over a sample, faults and disturbances too.
void sample(DesignModel& model, const BankRequest& request) {
  const Index m = model.B.cols();
  const Index k = model.faults.state.cols();
  const Index l = model.decoupled.state.cols();
  const Index w = model.weakened.state.cols();
  MatrixXd inputs(model.A.rows(), m + k + l + w);
  inputs << model.B, model.faults.state, model.decoupled.state, model.weakened.state;
  const SampledSystem sampled = request.domain == DesignDomain::kEuler
                                    ? discretize_euler(model.A, inputs, request.sample_time_s)
                                    : discretize_zoh(model.A, inputs, request.sample_time_s);
  model.A = sampled.A;
  model.B = sampled.B.leftCols(m);
  model.faults.state = sampled.B.middleCols(m, k);
  model.decoupled.state = sampled.B.middleCols(m + k, l);
  model.weakened.state = sampled.B.rightCols(w);
}

// Constant disturbances become states.
void append_constants(DesignModel& model, const Directions& constants) {
  const Index n = model.A.rows();
  const Index total = n + constants.state.cols();
  MatrixXd A = MatrixXd::Zero(total, total);
  A.topLeftCorner(n, n) = model.A;
  A.topRightCorner(n, total - n) = constants.state;
  MatrixXd C(model.C.rows(), total);
  C << model.C, constants.output;
  model.A = A;
  model.C = C;
  for (MatrixXd* columns :
       {&model.B, &model.faults.state, &model.decoupled.state, &model.weakened.state}) {
    *columns = with_rows(*columns, total);
  }
}

}  // namespace

DesignModel design_model(const PlantModel& plant, const BankRequest& request) {
  DesignModel model{plant.A,
                    plant.B,
                    plant.C,
                    plant.D,
                    fault_directions(plant),
                    named_disturbances(plant, request, "decouple", request.decouple),
                    weakened_disturbances(plant, request),
                    is_sampled(request.domain)};
  append_constants(
      model, named_disturbances(plant, request, "decouple_constant", request.decouple_constant));
  if (plant.time == TimeDomain::kDiscrete) {
    const Index constants = model.A.rows() - plant.n();
    model.A.bottomRightCorner(constants, constants).setIdentity();
  } else if (model.is_sampled) {
    sample(model, request);
  }
  return model;
}

Directions ignored_directions(const DesignModel& model, const FaultSet& ignores) {
  const auto count = std::ssize(ignores);
  const Index l = model.decoupled.state.cols();
  Directions directions{MatrixXd(model.A.rows(), count + l), MatrixXd(model.C.rows(), count + l)};
  Index i = 0;
  for (const std::size_t j : ignores) {
    directions.state.col(i) = model.faults.state.col(static_cast<Index>(j));
    directions.output.col(i++) = model.faults.output.col(static_cast<Index>(j));
  }
  directions.state.rightCols(l) = model.decoupled.state;
  directions.output.rightCols(l) = model.decoupled.output;
  return directions;
}

std::vector<BankDisturbance> disturbance_treatments(const PlantModel& plant,
                                                    const BankRequest& request) {
  using Treatment = BankDisturbance::Treatment;
  const auto names = [](const std::vector<std::string>& list, const std::string& name) {
    return std::find(list.begin(), list.end(), name) != list.end();
  };
  std::vector<BankDisturbance> treatments;
  for (const Disturbance& disturbance : plant.disturbances) {
    const std::string& name = disturbance.name;
    treatments.push_back({name, names(request.decouple, name)                ? Treatment::kDecoupled
                                : names(request.decouple_constant, name)     ? Treatment::kConstant
                                : names(request.eigenstructure.weaken, name) ? Treatment::kWeakened
                                                                             : Treatment::kNone});
  }
  return treatments;
}

}  // namespace faultline
