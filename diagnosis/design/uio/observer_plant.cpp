#include "diagnosis/design/uio/observer_plant.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "diagnosis/design/with_rows.h"
#include "diagnosis/model/discretize.h"
#include "diagnosis/model/toml_reader.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// 64 corners, one matrix inequality each.
constexpr std::size_t kMostNonlinearities = 6;

template <class Items, class Column>
MatrixXd columns_of(const Items& items, Index rows, Column column) {
  MatrixXd columns(rows, std::ssize(items));
  Index j = 0;
  for (const auto& item : items) columns.col(j++) = column(item);
  return columns;
}

// All that drives the state is held over a sample.
void sample(ObserverPlant& sampled, const BankRequest& request) {
  const double T = request.sample_time_s;
  std::vector<MatrixXd*> parts{&sampled.B, &sampled.fault_states, &sampled.disturbance_states,
                               &sampled.E_o};
  Index count = 0;
  for (const MatrixXd* part : parts) count += part->cols();
  MatrixXd all(sampled.A.rows(), count);
  Index at = 0;
  for (const MatrixXd* part : parts) {
    all.middleCols(at, part->cols()) = *part;
    at += part->cols();
  }
  const SampledSystem system = request.domain == DesignDomain::kEuler
                                   ? discretize_euler(sampled.A, all, T)
                                   : discretize_zoh(sampled.A, all, T);
  sampled.A = system.A;
  at = 0;
  for (MatrixXd* part : parts) {
    *part = system.B.middleCols(at, part->cols()).eval();
    at += part->cols();
  }
}

// Largest |w_i|, disturbances then noises; of the decoupled ones nothing need be known.
VectorXd bounds_of(const PlantModel& plant, const BankRequest& request,
                   const std::vector<std::size_t>& decoupled) {
  VectorXd bounds(std::ssize(plant.disturbances) + std::ssize(plant.noises));
  Index at = 0;
  for (std::size_t i = 0; i < plant.disturbances.size(); ++i) {
    const Disturbance& disturbance = plant.disturbances[i];
    const bool is_decoupled = std::find(decoupled.begin(), decoupled.end(), i) != decoupled.end();
    if (!disturbance.bound && !is_decoupled) {
      throw request_error(request, "plant",
                          fmt::format("found disturbance \"{}\" without a bound, expected one: it "
                                      "cannot be decoupled, so the thresholds have to hold against "
                                      "it",
                                      disturbance.name));
    }
    bounds[at++] = disturbance.bound.value_or(1.0);
  }
  for (std::size_t i = 0; i < plant.noises.size(); ++i) {
    if (!plant.noises[i].bound) {
      throw request_error(request, "plant",
                          fmt::format("found noise \"{}\" with `sigma` only, expected `bound`: "
                                      "proved thresholds need a bound",
                                      plant.noises[i].name));
    }
    bounds[at++] = *plant.noises[i].bound;
  }
  return bounds;
}

VectorXd state_bounds(const PlantModel& plant, const BankRequest& request) {
  if (!plant.state_range) {
    throw request_error(request, "plant",
                        fmt::format("found plant \"{}\" without `range` in [states], expected the "
                                    "largest deviation of each state: thresholds from start-up on "
                                    "begin with it",
                                    plant.name));
  }
  return *plant.state_range;
}

}  // namespace

ObserverPlant observer_plant(const PlantModel& plant, const BankRequest& request) {
  if (plant.nonlinearities.size() > kMostNonlinearities) {
    throw request_error(request, "plant",
                        fmt::format("found {} nonlinearities, expected at most {}: the bounds are "
                                    "proved at every corner of their slopes, and each doubles "
                                    "their number",
                                    plant.nonlinearities.size(), kMostNonlinearities));
  }
  ObserverPlant sampled;
  sampled.A = plant.A;
  sampled.B = plant.B;
  sampled.C = plant.C;
  sampled.D = plant.D;
  sampled.fault_states =
      columns_of(plant.faults, plant.n(), [](const Fault& fault) { return fault.state; });
  sampled.fault_outputs =
      columns_of(plant.faults, plant.q(), [](const Fault& fault) { return fault.output; });
  sampled.disturbance_states =
      columns_of(plant.disturbances, plant.n(), [](const Disturbance& item) { return item.state; });
  sampled.disturbance_outputs = columns_of(plant.disturbances, plant.q(),
                                           [](const Disturbance& item) { return item.output; });
  sampled.noise_outputs =
      columns_of(plant.noises, plant.q(), [](const Noise& noise) { return noise.output; });
  sampled.E_o = columns_of(plant.nonlinearities, plant.n(),
                           [](const Nonlinearity& item) { return item.E_o; });
  sampled.E_i = columns_of(plant.nonlinearities, plant.n(), [](const Nonlinearity& item) {
                  return item.E_i;
                }).transpose();
  if (plant.time == TimeDomain::kContinuous) sample(sampled, request);
  return sampled;
}

std::vector<std::size_t> fault_indices(const PlantModel& plant, const BankRequest& request,
                                       const std::string& key,
                                       const std::vector<std::string>& names) {
  const std::vector<std::string> known = plant.fault_names();
  std::vector<std::size_t> indices;
  for (const std::string& name : names) {
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end()) {
      const std::optional<std::string> near = nearest_name(name, known);
      throw request_error(request, "uio",
                          fmt::format("{}: found \"{}\", expected faults of plant \"{}\" ({}){}",
                                      key, name, plant.name, fmt::join(known, ", "),
                                      near ? fmt::format("; did you mean \"{}\"?", *near) : ""));
    }
    const auto index = static_cast<std::size_t>(found - known.begin());
    if (std::find(indices.begin(), indices.end(), index) != indices.end()) {
      throw request_error(request, "uio",
                          fmt::format("{}: found \"{}\" twice, expected it once", key, name));
    }
    indices.push_back(index);
  }
  return indices;
}

ObserverModel observer_model(const PlantModel& plant, const BankRequest& request,
                             const ObserverPlant& sampled, const ObserverTask& task,
                             const std::vector<std::size_t>& decoupled) {
  const Index n = plant.n();
  const Index carried = std::ssize(task.carry);
  const Index total = n + carried;
  ObserverModel model;
  model.slope_radius = VectorXd(std::ssize(plant.nonlinearities));
  model.A = MatrixXd::Identity(total, total);
  model.A.topLeftCorner(n, n) = sampled.A;
  Index i = 0;
  for (const Nonlinearity& item : plant.nonlinearities) {
    const double center = 0.5 * (item.slope_min + item.slope_max);
    model.A.topLeftCorner(n, n) += item.gain * center * sampled.E_o.col(i) * sampled.E_i.row(i);
    model.slope_radius[i++] = std::abs(item.gain) * 0.5 * (item.slope_max - item.slope_min);
  }
  model.C = MatrixXd::Zero(plant.q(), total);
  model.C.leftCols(n) = sampled.C;
  for (Index j = 0; j < carried; ++j) {
    const auto fault = static_cast<Index>(task.carry[static_cast<std::size_t>(j)]);
    model.A.col(n + j).head(n) = sampled.fault_states.col(fault);
    model.C.col(n + j) = sampled.fault_outputs.col(fault);
  }
  model.E_o = with_rows(sampled.E_o, total);
  model.E_i = MatrixXd::Zero(sampled.E_i.rows(), total);
  model.E_i.leftCols(n) = sampled.E_i;

  const Index disturbances = std::ssize(plant.disturbances);
  const Index noises = std::ssize(plant.noises);
  model.M = MatrixXd::Zero(total, disturbances + noises + carried);
  model.M.topLeftCorner(n, disturbances) = sampled.disturbance_states;
  model.M.bottomRightCorner(carried, carried).setIdentity();
  model.W = MatrixXd::Zero(plant.q(), model.M.cols());
  model.W.leftCols(disturbances) = sampled.disturbance_outputs;
  model.W.middleCols(disturbances, noises) = sampled.noise_outputs;
  model.w_bound = VectorXd::Constant(model.M.cols(), task.drift_bound);
  model.w_bound.head(disturbances + noises) = bounds_of(plant, request, decoupled);

  model.F_x = MatrixXd::Zero(total, std::ssize(task.detect));
  model.F_y = MatrixXd(plant.q(), std::ssize(task.detect));
  for (Index j = 0; j < model.F_x.cols(); ++j) {
    const auto fault = static_cast<Index>(task.detect[static_cast<std::size_t>(j)]);
    model.F_x.col(j).head(n) = sampled.fault_states.col(fault);
    model.F_y.col(j) = sampled.fault_outputs.col(fault);
  }
  model.x_bound = VectorXd::Zero(total);
  model.x_bound.head(n) = state_bounds(plant, request);
  return model;
}

}  // namespace faultline
