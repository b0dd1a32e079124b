/* CVODE (BDF, dense Newton, Jacobian by difference quotients or given) with nothing of Python in the loop.

   Built by cvode_from_c.py as a shared library; right-hand side and Jacobian are addresses of compiled functions.
   Written for SUNDIALS 6 and 7. Returns 0, or the failing step's number as a negative value. */

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_version.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

typedef void (*rhs_t)(double t, const double *y, double *dy, const double *table, long long size);

struct problem {
  rhs_t rhs;
  rhs_t jacobian; /* fills the matrix column by column; NULL: difference quotients */
  const double *table;
  long long size;
};

static int forward(sunrealtype t, N_Vector y, N_Vector dy, void *data) {
  struct problem *p = data;
  p->rhs(t, N_VGetArrayPointer(y), N_VGetArrayPointer(dy), p->table, p->size);
  return 0;
}

static int linearised(sunrealtype t, N_Vector y, N_Vector dy, SUNMatrix a, void *data, N_Vector x1, N_Vector x2,
                      N_Vector x3) {
  struct problem *p = data;
  p->jacobian(t, N_VGetArrayPointer(y), SUNDenseMatrix_Data(a), p->table, p->size);
  return 0;
}

const char *version(void) { return SUNDIALS_VERSION; }

/* out: (n_times, n) states; counts: steps, rejected, right-hand sides, Jacobians */
int solve(rhs_t rhs, rhs_t jacobian, const double *table, long long size, int n, const double *y0, int n_times,
          const double *times, double tolerance, double *out, long long *counts) {
  struct problem p = {rhs, jacobian, table, size};
  SUNContext context = NULL;
#if SUNDIALS_VERSION_MAJOR >= 7
  if (SUNContext_Create(SUN_COMM_NULL, &context)) return -1;
#else
  if (SUNContext_Create(NULL, &context)) return -1;
#endif
  N_Vector y = N_VNew_Serial(n, context);
  for (int i = 0; i < n; i++) NV_Ith_S(y, i) = out[i] = y0[i];
  SUNMatrix a = SUNDenseMatrix(n, n, context);
  SUNLinearSolver solver = SUNLinSol_Dense(y, a, context);
  void *memory = CVodeCreate(CV_BDF, context);
  int status = -2;
  long steps = 0, calls = 0, jacobians = 0, error_fails = 0, newton_fails = 0, extra = 0;
  if (CVodeInit(memory, forward, times[0], y) || CVodeSStolerances(memory, tolerance, tolerance) ||
      CVodeSetUserData(memory, &p) || CVodeSetLinearSolver(memory, solver, a) ||
      CVodeSetMaxNumSteps(memory, 10000000))
    goto end;
  if (jacobian && CVodeSetJacFn(memory, linearised)) goto end;
  for (int k = 1; k < n_times; k++) {
    sunrealtype t;
    status = CVode(memory, times[k], y, &t, CV_NORMAL) < 0 ? -2 - k : 0;
    if (status) goto end;
    for (int i = 0; i < n; i++) out[k * n + i] = NV_Ith_S(y, i);
  }
  CVodeGetNumSteps(memory, &steps);
  CVodeGetNumErrTestFails(memory, &error_fails);
  CVodeGetNumStepSolveFails(memory, &newton_fails);
  CVodeGetNumRhsEvals(memory, &calls);
  CVodeGetNumLinRhsEvals(memory, &extra);
  CVodeGetNumJacEvals(memory, &jacobians);
  counts[0] = steps;
  counts[1] = error_fails + newton_fails;
  counts[2] = calls + extra;
  counts[3] = jacobians;
end:
  CVodeFree(&memory);
  SUNLinSolFree(solver);
  SUNMatDestroy(a);
  N_VDestroy(y);
  SUNContext_Free(&context);
  return status;
}
