#include "diagnosis/design/eigenstructure/weakened_residual.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "diagnosis/design/joined_matrices.h"
#include "diagnosis/design/requested_poles.h"
#include "diagnosis/design/subspace.h"

namespace faultline {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// More rows must be worth so much.
constexpr double kWorthARow = 1.05;

const char* criterion_name(CompromiseCriterion criterion) {
  switch (criterion) {
    case CompromiseCriterion::kLowRank:
      return "low_rank";
    case CompromiseCriterion::kStatic:
      return "static";
    case CompromiseCriterion::kWorstCase:
      return "worst_case";
    case CompromiseCriterion::kRms:
      break;
  }
  return "rms";
}

bool is_by_gain(CompromiseCriterion criterion) {
  return criterion == CompromiseCriterion::kWorstCase || criterion == CompromiseCriterion::kRms;
}

// z = Θ M w where the rows of Θ M are left eigenvectors: z' = Λ z - (Θ M E_0 - X H) y + ..,
// Θ M A_0 = Λ Θ M + X M.
struct LeftPart {
  bool exists = false;
  MatrixXd T;  // Θ M
  MatrixXd Lambda;
  MatrixXd X;
};

LeftPart left_part(const CompromiseTask& task, const MatrixXd& Theta, const BankRequest& request,
                   const std::string& name) {
  LeftPart part;
  part.T = Theta * task.M;
  const Index p = part.T.rows();
  SubspaceArithmetic arithmetic;
  const double scale = data_scale(task.M);
  const MatrixXd unseen = arithmetic.kernel(task.M, scale);
  const MatrixXd leaves = part.T / scale * (task.A_0 / data_scale(task.A_0)) * unseen;
  if (arithmetic.image(part.T / scale, 1.0).cols() < p ||
      arithmetic.image(leaves, 1.0).cols() > 0) {
    return part;
  }
  part.exists = true;
  if (request.decay_rate_per_s) {
    const double decay = requested_decay(request);
    part.Lambda = (task.is_sampled ? decay : -decay) * MatrixXd::Identity(p, p);
  } else {
    part.Lambda = real_block_diagonal(requested_poles(request, name, p));
  }
  part.X = (part.T * task.A_0 - part.Lambda * part.T) * arithmetic.pseudo_inverse(task.M, scale);
  return part;
}

CompromiseTask task_of(const LeftPart& left, const MatrixXd& Theta, const CompromiseTask& task) {
  const auto reduced = [&](const Directions& all) {
    return Directions{left.T * all.state - left.X * all.output, Theta * all.output};
  };
  return {left.Lambda, MatrixXd::Identity(left.T.rows(), left.T.rows()), reduced(task.unknown),
          reduced(task.wanted), task.is_sampled};
}

class Weakening {
 public:
  Weakening(const GeometricQuotient& quotient, const CompromiseTask& task,
            const BankRequest& request, const std::string& name)
      : task_(task), request_(request), name_(name) {
    result_.quotient = quotient;
    result_.report.criterion = criterion_name(request.eigenstructure.criterion);
    const UnknownInputSpread spread = unknown_input_spread(task);
    result_.report.singular_values.assign(spread.singular_values.begin(),
                                          spread.singular_values.end());
    spread_ = side_by_side(task.unknown.output, task.M * task.unknown.state);
  }

  WeakenedResidual run() {
    const PolePlacement placement = requested_placement(request_, name_, result_.quotient);
    if (!placement.is_possible) {
      result_.reason = placement.reason;
      return std::move(result_);
    }
    const CompromiseCriterion criterion = measure();
    const Index q = task_.M.rows();
    result_.report.ratio_before =
        compromise_ratio(task_, placement.D_1, MatrixXd::Identity(q, q), criterion);
    if (is_by_gain(request_.eigenstructure.criterion)) {
      choose_by_gain(placement.D_1, criterion);
    } else {
      choose_by_spread(placement.D_1, criterion);
    }
    return std::move(result_);
  }

 private:
  // What the ratios of the report are about.
  [[nodiscard]] CompromiseCriterion measure() const {
    return request_.eigenstructure.criterion == CompromiseCriterion::kRms
               ? CompromiseCriterion::kRms
               : CompromiseCriterion::kWorstCase;
  }

  [[nodiscard]] Index rows_of(const std::vector<RowsTrial>& trials, Index otherwise) const {
    const Index most = std::ssize(trials);
    return request_.eigenstructure.rows
               ? std::min(static_cast<Index>(*request_.eigenstructure.rows), most)
               : std::min(otherwise, most);
  }

  [[nodiscard]] double low_rank_cost(Index rows) const {
    double sum = 0.0;
    for (Index i = 0; i < rows; ++i) {
      const double value = result_.report.singular_values[static_cast<std::size_t>(i)];
      sum += value * value;
    }
    return std::sqrt(sum);
  }

  void note_choice(const MatrixXd& Theta, double ratio, const std::string& gain) {
    WeakeningReport& report = result_.report;
    SubspaceArithmetic arithmetic;
    const MatrixXd rows = arithmetic.image(Theta.transpose(), data_scale(Theta));
    report.rows = Theta.rows();
    report.approximated = (rows.transpose() * spread_).norm();
    report.ratio_after = ratio;
    report.gain = gain;
  }

  void finish(const MatrixXd& Theta, const MatrixXd& D_1) {
    GeometricQuotient& quotient = result_.quotient;
    PolePlacement placement;
    placement.D_1 = D_1;
    result_.filter = complete_filter(quotient, placement);
    quotient.M = (Theta * quotient.M).eval();
    quotient.H = (Theta * quotient.H).eval();
  }

  void finish(const MatrixXd& Theta, const LeftPart& left) {
    GeometricQuotient& quotient = result_.quotient;
    result_.filter = {left.Lambda, left.T * quotient.E_0 - left.X * quotient.H};
    quotient.P = (left.T * quotient.P).eval();
    quotient.H = (Theta * quotient.H).eval();
    quotient.M = MatrixXd::Identity(left.T.rows(), left.T.rows());
    quotient.A_0 = MatrixXd::Zero(left.T.rows(), left.T.rows());
    quotient.E_0 = result_.filter.E;
  }

  void choose_by_gain(const MatrixXd& placed, CompromiseCriterion criterion) {
    std::vector<MatrixXd> gains{placed};
    if (request_.decay_rate_per_s) {
      for (MatrixXd& D_1 : trade_off_gains(task_, requested_decay(request_))) {
        gains.push_back(std::move(D_1));
      }
    }
    const Index q = task_.M.rows();
    std::vector<Compromise> best(static_cast<std::size_t>(q));
    std::vector<std::size_t> best_gain(best.size());
    for (std::size_t g = 0; g < gains.size(); ++g) {
      const std::vector<Compromise> found = compromises_by_gain(task_, gains[g], criterion);
      for (std::size_t p = 0; p < best.size(); ++p) {
        if (found[p].is_possible && (!best[p].is_possible || found[p].ratio < best[p].ratio)) {
          best[p] = found[p];
          best_gain[p] = g;
        } else if (!best[p].is_possible) {
          best[p].reason = found[p].reason;
        }
      }
    }
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t p = 0; p < best.size(); ++p) {
      const double ratio =
          best[p].is_possible ? best[p].ratio : std::numeric_limits<double>::infinity();
      least = std::min(least, ratio);
      result_.report.trade_off.push_back(
          {static_cast<Index>(p) + 1, ratio, low_rank_cost(static_cast<Index>(p) + 1)});
    }
    Index enough = q;
    for (Index p = q; p >= 1; --p) {
      if (result_.report.trade_off[static_cast<std::size_t>(p - 1)].ratio <= kWorthARow * least) {
        enough = p;
      }
    }
    const auto chosen = static_cast<std::size_t>(rows_of(result_.report.trade_off, enough) - 1);
    if (!best[chosen].is_possible) {
      result_.reason = fmt::format("no compromise of {} row{}: {}", chosen + 1,
                                   chosen == 0 ? "" : "s", best[chosen].reason);
      return;
    }
    note_choice(best[chosen].Theta, best[chosen].ratio,
                best_gain[chosen] == 0 ? "that of the poles asked for"
                                       : "a Kalman filter's, shifted by the decay rate");
    finish(best[chosen].Theta, gains[best_gain[chosen]]);
  }

  void choose_by_spread(const MatrixXd& placed, CompromiseCriterion criterion) {
    const bool is_static = request_.eigenstructure.criterion == CompromiseCriterion::kStatic;
    if (is_static && !task_.unknown.output.isZero(0.0)) {
      result_.reason =
          "criterion \"static\" is about unknown inputs of the states, and one of these reaches an "
          "output directly: expected \"low_rank\", \"worst_case\" or \"rms\"";
      return;
    }
    const Index q = task_.M.rows();
    MatrixXd chosen_rows;
    LeftPart chosen_left;
    double chosen_ratio = 0.0;
    std::vector<MatrixXd> rows;
    std::vector<LeftPart> left;
    for (Index p = 1; p <= q; ++p) {
      MatrixXd Theta = is_static ? static_rows(task_, p) : low_rank_rows(task_, p);
      if (Theta.rows() < p) {
        break;
      }
      LeftPart part = left_part(task_, Theta, request_, name_);
      const double ratio = part.exists
                               ? compromise_ratio(task_of(part, Theta, task_), MatrixXd::Zero(p, p),
                                                  MatrixXd::Identity(p, p), criterion)
                               : compromise_ratio(task_, placed, Theta, criterion);
      result_.report.trade_off.push_back({p, ratio, low_rank_cost(p)});
      rows.push_back(std::move(Theta));
      left.push_back(std::move(part));
    }
    const auto enough =
        std::find_if(result_.report.trade_off.begin(), result_.report.trade_off.end(),
                     [](const RowsTrial& trial) { return std::isfinite(trial.ratio); });
    const Index fewest = enough == result_.report.trade_off.end() ? 1 : enough->rows;
    const auto chosen = static_cast<std::size_t>(rows_of(result_.report.trade_off, fewest) - 1);
    chosen_rows = rows[chosen];
    chosen_left = left[chosen];
    chosen_ratio = result_.report.trade_off[chosen].ratio;
    if (!std::isfinite(chosen_ratio)) {
      result_.reason = fmt::format(
          "its {} row{} of least unknown input do{} not see a fault that is wanted: expected "
          "criterion \"worst_case\" or \"rms\", which reckon with the faults, or more rows",
          chosen + 1, chosen == 0 ? "" : "s", chosen == 0 ? "es" : "");
      return;
    }
    if (chosen_left.exists) {
      note_choice(chosen_rows, chosen_ratio, "its rows are left eigenvectors");
      finish(chosen_rows, chosen_left);
    } else {
      note_choice(chosen_rows, chosen_ratio, "that of the poles asked for");
      finish(chosen_rows, placed);
    }
  }

  const CompromiseTask& task_;
  const BankRequest& request_;
  const std::string& name_;
  MatrixXd spread_;  // Ē
  WeakenedResidual result_;
};

}  // namespace

WeakenedResidual weakened_residual(const GeometricQuotient& quotient, const CompromiseTask& task,
                                   const BankRequest& request, const std::string& name) {
  return Weakening(quotient, task, request, name).run();
}

}  // namespace faultline
