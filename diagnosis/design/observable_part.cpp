#include "diagnosis/design/observable_part.h"

#include <utility>

#include "diagnosis/bank/bank.h"
#include "diagnosis/design/joined_matrices.h"

namespace faultline {

using Eigen::Index;
using Eigen::MatrixXd;

ObservablePart observable_part(const MatrixXd& A, const MatrixXd& C,
                               SubspaceArithmetic& arithmetic) {
  const Index n = A.rows();
  ObservablePart part;
  MatrixXd hidden = MatrixXd::Identity(n, n);
  if (n > 0 && C.rows() > 0) {
    // A - α I has the same subspaces, and no part common to all eigenvalues hides the others.
    const MatrixXd A_shifted = A - A.trace() / static_cast<double>(n) * MatrixXd::Identity(n, n);
    const MatrixXd A_unit = A_shifted / data_scale(A_shifted);
    const MatrixXd C_unit = C / data_scale(C);
    for (;;) {
      const MatrixXd leaves = complement(hidden).transpose() * A_unit;
      MatrixXd next = arithmetic.kernel(stacked(leaves, C_unit), 1.0);
      if (next.cols() >= hidden.cols()) {
        break;
      }
      hidden = std::move(next);
    }
  }
  part.basis = complement(hidden);
  part.A = part.basis.transpose() * A * part.basis;
  part.C = C * part.basis;
  const Eigen::VectorXcd rest = eigenvalues(hidden.transpose() * A * hidden);
  part.unobservable.assign(rest.begin(), rest.end());
  return part;
}

}  // namespace faultline
