#include <algorithm>
#include <cassert>
#include <cstdlib>
#include <mutex>
#include <new>
#include <stdexcept>
#include <tuple>

#include <dlfcn.h>

#include "diagnosis/design/lmi/semidefinite_program.h"

extern "C" {
#include <csdp/declarations.h>
#include <csdp/parameters.h>
}

namespace {

// What passes solve() and initparams() below, with CSDP between them; guarded by solve()'s mutex.
/// Calls of initparams(): tells whether ours is the one that CSDP was linked with.
int parameter_calls = 0;
/// atytol: CSDP's default at most.
constexpr double kLargestResidual = 1e-8;
double equation_residual = kLargestResidual;

}  // namespace

extern "C" {

/// Takes the place of CSDP's own function of this name, which reads ./param.csdp: answers would
/// depend on the working directory. The linker prefers the definition in the program (or in the
/// library that contains this file) to the one in libsdp; solve() checks that it did.
void initparams(struct paramstruc* parameters, int* print_level) {
  ++parameter_calls;
  // CSDP's defaults, but for atytol (1e-8 there) and maxiter (100).
  parameters->axtol = 1e-8;
  parameters->atytol = equation_residual;
  parameters->objtol = 1e-8;
  parameters->pinftol = 1e8;
  parameters->dinftol = 1e8;
  parameters->maxiter = 200;
  parameters->minstepfrac = 0.90;
  parameters->maxstepfrac = 0.97;
  parameters->minstepp = 1e-8;
  parameters->minstepd = 1e-8;
  parameters->usexzgap = 1;
  parameters->tweakgap = 0;
  parameters->affine = 0;
  parameters->perturbobj = 1;
  parameters->fastmode = 0;
  *print_level = 0;
}

}  // extern "C"

namespace faultline {
namespace {

using Entry = SemidefiniteProgram::Entry;

/// Memory that CSDP will free().
template <typename T>
T* allocate(std::size_t count) {
  void* memory = std::calloc(std::max<std::size_t>(count, 1), sizeof(T));
  if (memory == nullptr) throw std::bad_alloc();
  return static_cast<T*>(memory);
}

/// Where a block of ours is in CSDP's: blocks of size one become the entries of a single diagonal
/// one, which saves CSDP a matrix each.
struct Place {
  int block = 0;   // from 1
  int offset = 0;  // of the row
};

/// One CSDP problem: owns what CSDP allocates and frees.
class CsdpProblem {
 public:
  explicit CsdpProblem(const SemidefiniteProgram& program)
      : m_(static_cast<int>(program.c.size())) {
    place_blocks(program);
    allocate_C();
    a_ = allocate<double>(static_cast<std::size_t>(m_) + 1);
    std::copy(program.c.begin(), program.c.end(), a_ + 1);
    constraints_ = allocate<constraintmatrix>(static_cast<std::size_t>(m_) + 1);
    fill(program);
    initsoln(size_, m_, C_, a_, constraints_, &X_, &y_, &Z_);
  }
  CsdpProblem(const CsdpProblem&) = delete;
  CsdpProblem& operator=(const CsdpProblem&) = delete;
  ~CsdpProblem() { free_prob(size_, m_, C_, a_, constraints_, X_, y_, Z_); }

  SolverAnswer solve(const SemidefiniteProgram& program) {
    SolverAnswer answer;
    // In CSDP's words our program is the dual: its "primal objective" is our dual's.
    answer.code = easy_sdp(size_, m_, C_, a_, constraints_, 0.0, &X_, &y_, &Z_,
                           &answer.dual_objective, &answer.objective);
    answer.x = Eigen::Map<Eigen::VectorXd>(y_ + 1, m_);
    for (std::size_t b = 0; b < places_.size(); ++b) {
      answer.X.push_back(dual_block(places_[b], program.block_sizes[b]));
    }
    return answer;
  }

 private:
  void place_blocks(const SemidefiniteProgram& program) {
    int diagonal_size = 0;
    for (const Eigen::Index size : program.block_sizes) {
      size_ += static_cast<int>(size);
      if (size == 1) {
        places_.push_back({0, diagonal_size++});
      } else {
        sizes_.push_back(static_cast<int>(size));
        places_.push_back({static_cast<int>(sizes_.size()), 0});
      }
    }
    if (diagonal_size == 0) return;
    sizes_.push_back(diagonal_size);
    diagonal_block_ = static_cast<int>(sizes_.size());
    for (Place& place : places_) {
      if (place.block == 0) place.block = diagonal_block_;
    }
  }

  void allocate_C() {
    C_.nblocks = static_cast<int>(sizes_.size());
    C_.blocks = allocate<blockrec>(sizes_.size() + 1);
    for (std::size_t b = 0; b < sizes_.size(); ++b) {
      blockrec& block = C_.blocks[b + 1];
      const auto size = static_cast<std::size_t>(sizes_[b]);
      block.blocksize = sizes_[b];
      if (static_cast<int>(b) + 1 == diagonal_block_) {
        block.blockcategory = DIAG;
        block.data.vec = allocate<double>(size + 1);
      } else {
        block.blockcategory = MATRIX;
        block.data.mat = allocate<double>(size * size);
      }
    }
  }

  void fill(const SemidefiniteProgram& program) {
    struct PlacedEntry {
      int variable, block, row, col;
      double value;
    };
    std::vector<PlacedEntry> placed;
    placed.reserve(program.entries.size());
    for (const Entry& entry : program.entries) {
      const Place& place = places_[static_cast<std::size_t>(entry.block)];
      const PlacedEntry p = {static_cast<int>(entry.variable), place.block,
                             static_cast<int>(entry.row) + place.offset + 1,
                             static_cast<int>(entry.col) + place.offset + 1, entry.value};
      if (entry.variable < 0) {
        set_C(p.block, p.row, p.col, p.value);
      } else {
        placed.push_back(p);
      }
    }
    const auto key = [](const PlacedEntry& e) {
      return std::tie(e.variable, e.block, e.col, e.row);
    };
    std::sort(placed.begin(), placed.end(),
              [&](const PlacedEntry& a, const PlacedEntry& b) { return key(a) > key(b); });
    // Blocks of a constraint are a list: pushed in front, so the last block goes in first.
    for (std::size_t first = 0, end = 0; first < placed.size(); first = end) {
      while (end < placed.size() && placed[end].variable == placed[first].variable &&
             placed[end].block == placed[first].block) {
        ++end;
      }
      auto* block = allocate<sparseblock>(1);
      constraintmatrix& constraint = constraints_[placed[first].variable + 1];
      block->next = constraint.blocks;
      constraint.blocks = block;
      block->constraintnum = placed[first].variable + 1;
      block->blocknum = placed[first].block;
      block->blocksize = sizes_[static_cast<std::size_t>(placed[first].block) - 1];
      block->numentries = static_cast<int>(end - first);
      block->issparse = 1;
      block->entries = allocate<double>(end - first + 1);
      block->iindices = allocate<int>(end - first + 1);
      block->jindices = allocate<int>(end - first + 1);
      for (std::size_t i = first; i < end; ++i) {
        block->entries[i - first + 1] = placed[i].value;
        block->iindices[i - first + 1] = placed[i].row;
        block->jindices[i - first + 1] = placed[i].col;
      }
    }
  }

  void set_C(int block, int row, int col, double value) {
    blockrec& target = C_.blocks[block];
    if (block == diagonal_block_) {
      target.data.vec[row] = value;
    } else {
      target.data.mat[ijtok(row, col, target.blocksize)] = value;
      target.data.mat[ijtok(col, row, target.blocksize)] = value;
    }
  }

  [[nodiscard]] Eigen::MatrixXd dual_block(const Place& place, Eigen::Index size) const {
    const blockrec& block = X_.blocks[place.block];
    if (place.block == diagonal_block_) {
      return Eigen::MatrixXd::Constant(1, 1, block.data.vec[place.offset + 1]);
    }
    return Eigen::Map<const Eigen::MatrixXd>(block.data.mat, size, size);
  }

  int m_ = 0;
  int size_ = 0;            // of all blocks together
  std::vector<int> sizes_;  // CSDP's blocks
  std::vector<Place> places_;
  int diagonal_block_ = 0;  // 0: none
  blockmatrix C_{}, X_{}, Z_{};
  double* a_ = nullptr;
  double* y_ = nullptr;
  constraintmatrix* constraints_ = nullptr;
};

/// Has OpenBLAS, if it is there, work with one thread while it lives. A symbol of the process is
/// asked for, not an environment variable set: that would reach whoever is started next.
class OneBlasThread {
 public:
  OneBlasThread() {
    const auto get = reinterpret_cast<int (*)()>(dlsym(RTLD_DEFAULT, "openblas_get_num_threads"));
    set_ = reinterpret_cast<void (*)(int)>(dlsym(RTLD_DEFAULT, "openblas_set_num_threads"));
    if (get == nullptr || set_ == nullptr) return;
    before_ = get();
    if (before_ != 1) set_(1);
  }
  OneBlasThread(const OneBlasThread&) = delete;
  OneBlasThread& operator=(const OneBlasThread&) = delete;
  ~OneBlasThread() {
    if (before_ > 1) set_(before_);
  }

 private:
  void (*set_)(int) = nullptr;
  int before_ = 1;
};

SolverOutcome outcome_of(int code) {
  switch (code) {
    case 0:
      return SolverOutcome::kOptimal;
    case 1:  // "primal infeasible": the primal is our dual
      return SolverOutcome::kUnbounded;
    case 2:
      return SolverOutcome::kInfeasible;
    case 3:
      return SolverOutcome::kReducedAccuracy;
    default:
      return SolverOutcome::kStuck;
  }
}

}  // namespace

SolverAnswer solve(const SemidefiniteProgram& program, double residual) {
  SolverAnswer answer;
  if (program.c.size() > kLargestProgram) {
    answer.outcome = SolverOutcome::kTooLarge;
    return answer;
  }
  assert(program.c.size() > 0);
  static std::mutex mutex;  // op_o() of CSDP keeps a static work array
  const std::lock_guard lock(mutex);
  const OneBlasThread one_thread;
  const int calls_before = parameter_calls;
  equation_residual = std::min(residual, kLargestResidual);
  answer = CsdpProblem(program).solve(program);
  if (parameter_calls == calls_before) {
    throw std::runtime_error(
        "CSDP took its parameters from a function initparams() that is not Faultline's: link "
        "faultline's design library before libsdp, and nothing else that defines it");
  }
  answer.outcome = outcome_of(answer.code);
  return answer;
}

}  // namespace faultline
