/* A plant as a table of plain C: what a shared library gives to `--plant-lib`, and what the plants
 * that ship with Faultline are. C and C++ (sim/plant_equations.h makes one from a class).
 *
 *     dx/dt = f(x, u, p, d)        y = h(x, u, p, d)
 *
 * x state (n), u inputs (m), p parameters, d disturbances, y outputs (q), all absolute and in the
 * units given here. The functions must be pure: the same arguments, the same results, no memory. */
#ifndef FAULTLINE_PLANT_TABLE_H
#define FAULTLINE_PLANT_TABLE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A C header, in C's manner. NOLINTBEGIN(modernize-use-using, readability-identifier-naming) */

/* A state, input, output, parameter or disturbance. */
typedef struct faultline_plant_signal {
  const char* name;
  const char* unit; /* "" none */
  double nominal;   /* state, input: at the operating point; parameter: its value; else 0 */
  double size;      /* state, input, output: largest |deviation| to be expected; parameter: what
                       counts as a fault of size one, 0 if it is no fault; disturbance: its bound,
                       0 if unknown */
} faultline_plant_signal;

#define FAULTLINE_PLANT_VERSION 1u

typedef struct faultline_plant_table {
  uint32_t version; /* FAULTLINE_PLANT_VERSION */
  uint32_t size;    /* sizeof(faultline_plant_table) */
  const char* name;
  const char* description; /* one line */
  const char* source;      /* where equations and parameters are from */
  size_t state_count, input_count, output_count, parameter_count, disturbance_count;
  const faultline_plant_signal *states, *inputs, *outputs, *parameters, *disturbances;
  void (*derivative)(const double* x, const double* u, const double* p, const double* d,
                     double* dx);
  void (*measure)(const double* x, const double* u, const double* p, const double* d, double* y);
  /* Where f is not smooth. The integrator stops where one of g changes its sign, calls `on_event`,
   * which may change the state (a tank that is full, a stop that is hit), and begins anew.
   * event_count 0: none, and both may be null. */
  size_t event_count;
  void (*events)(const double* x, const double* u, const double* p, const double* d, double* g);
  void (*on_event)(size_t event, const double* u, const double* p, const double* d, double* x);
} faultline_plant_table;

/* The entry point of a shared library. The table must live as long as the library is loaded. */
#define FAULTLINE_PLANT_ENTRY "faultline_plant_v1"
const faultline_plant_table* faultline_plant_v1(void);

/* NOLINTEND(modernize-use-using, readability-identifier-naming) */

#ifdef __cplusplus
}
#endif
#endif
