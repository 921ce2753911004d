#include "diagnosis/design/explain_failure.h"

#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

std::string names_of(const PlantModel& plant, const FaultSet& faults) {
  std::vector<std::string> names;
  for (const std::size_t j : faults) {
    names.push_back(plant.faults[j].name);
  }
  return fmt::format("{}", fmt::join(names, ", "));
}

DesignModel without_disturbances(const DesignModel& model) {
  DesignModel free = model;
  free.decoupled.state.resize(model.A.rows(), 0);
  free.decoupled.output.resize(model.C.rows(), 0);
  return free;
}

GeometricQuotient quotient_of(const DesignModel& model, const FaultSet& ignores) {
  return geometric_quotient(model.A, model.C, ignored_directions(model, ignores), model.faults);
}

bool is_seen(const GeometricQuotient& quotient, std::size_t fault) {
  return quotient.H.rows() > 0 && quotient.visible_margin[fault] > kRankTolerance;
}

// Rank of directions (state and output part), each of length one in balanced units.
Index direction_rank(const DesignModel& model, const FaultSet& faults) {
  const Balance units = balance(model.A, model.C, model.faults);
  MatrixXd directions(model.A.rows() + model.C.rows(), std::ssize(faults));
  Index i = 0;
  for (const std::size_t j : faults) {
    const auto column = static_cast<Index>(j);
    directions.col(i) << model.faults.state.col(column).cwiseQuotient(units.state),
        model.faults.output.col(column).cwiseQuotient(units.output);
    directions.col(i++).stableNormalize();
  }
  return SubspaceArithmetic().image(directions, 1.0).cols();
}

Index output_rank(const MatrixXd& C) {
  return C.size() == 0 ? 0 : SubspaceArithmetic().image(C, C.norm()).cols();
}

std::string plural(std::size_t count, const char* word) {
  return fmt::format("{} {}{}", count, word, count == 1 ? "" : "s");
}

std::string decoupled_names(const DesignModel& model) {
  return model.decoupled.state.cols() == 1 ? "the decoupled disturbance takes"
                                           : "the decoupled disturbances take";
}

}  // namespace

FailureExplainer::FailureExplainer(const PlantModel& plant, const DesignModel& model)
    : plant_(plant),
      model_(model),
      free_(without_disturbances(model)),
      all_seen_(quotient_of(free_, {})) {}

bool FailureExplainer::has_disturbances() const { return model_.decoupled.state.cols() > 0; }

std::string FailureExplainer::no_residual(const FaultSet& ignores) const {
  const Index rank_C = output_rank(model_.C);
  if (rank_C == 0) {
    return "there is no output that the states reach";
  }
  if (has_disturbances() && quotient_of(free_, ignores).H.rows() > 0) {
    return fmt::format("{} the outputs it needs; without decoupling it would exist",
                       decoupled_names(model_));
  }
  const std::string rank = fmt::format("rank C W* = rank C = {}", rank_C);
  if (rank_C <= std::ssize(ignores)) {
    return fmt::format("{}: {} cannot do without {}, more outputs than ignored faults are needed",
                       rank, plural(static_cast<std::size_t>(rank_C), "independent output"),
                       plural(ignores.size(), "fault"));
  }
  return fmt::format("{}: {} move every output", rank, names_of(plant_, ignores));
}

std::string FailureExplainer::unseen(const FaultSet& ignores, std::size_t fault,
                                     const GeometricQuotient& quotient) const {
  if (!is_seen(all_seen_, fault)) {
    return "it reaches no output";
  }
  if (has_disturbances() && is_seen(quotient_of(free_, ignores), fault)) {
    return fmt::format("{} the outputs it needs; without decoupling it would be seen",
                       decoupled_names(model_));
  }
  FaultSet all = ignores;
  all.push_back(fault);
  if (const Index rank = direction_rank(model_, all); rank < std::ssize(all)) {
    const Index of_ignored = ignores.empty() ? 0 : direction_rank(model_, ignores);
    if (rank == of_ignored) {
      return fmt::format("its direction depends on those of {} (Corollary 1: rank {}, {} needed)",
                         names_of(plant_, ignores), rank, all.size());
    }
  }
  if (quotient.H.rows() == 0) {
    return no_residual(ignores);
  }
  return fmt::format(
      "its direction lies in S*, dim {}: whatever ignores {} cannot see it, though its direction "
      "is "
      "independent (Corollary 1 holds; it is not sufficient)",
      quotient.dim_s, ignores.empty() ? "the disturbances" : names_of(plant_, ignores));
}

}  // namespace faultline
