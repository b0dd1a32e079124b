/* CVODE (BDF, dense, difference-quotient Jacobian) on a compiled right-hand side, no Python in the loop.
   Built and called by benchmarks/peers.py. Returns the number of right-hand sides, or minus CVODE's flag. */
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sundials/sundials_version.h>

typedef void (*right_side)(double, double *, double *, void *);
struct problem { right_side f; void *data; };

static int call(sunrealtype t, N_Vector y, N_Vector out, void *user) {
  struct problem *p = user;
  p->f(t, N_VGetArrayPointer(y), N_VGetArrayPointer(out), p->data);
  return 0;
}

long run(right_side f, void *data, int n, double *start, int outputs, double *times, double *rows, double tolerance,
         double longest, long *steps) {
  struct problem problem = {f, data};
  SUNContext context;
#if SUNDIALS_VERSION_MAJOR >= 7
  SUNContext_Create(SUN_COMM_NULL, &context);
#else
  SUNContext_Create(NULL, &context);
#endif
  N_Vector y = N_VNew_Serial(n, context);
  for (int i = 0; i < n; i++) N_VGetArrayPointer(y)[i] = start[i];
  void *solver = CVodeCreate(CV_BDF, context);
  CVodeInit(solver, call, times[0], y);
  CVodeSStolerances(solver, tolerance, tolerance);
  CVodeSetUserData(solver, &problem);
  CVodeSetMaxNumSteps(solver, 10000000);
  CVodeSetMaxStep(solver, longest);
  SUNMatrix matrix = SUNDenseMatrix(n, n, context);
  SUNLinearSolver linear = SUNLinSol_Dense(y, matrix, context);
  CVodeSetLinearSolver(solver, linear, matrix);
  long count = 0;
  for (int i = 0; i < n; i++) rows[i] = start[i];
  for (int k = 1; k < outputs && count >= 0; k++) {
    sunrealtype t;
    int flag = CVode(solver, times[k], y, &t, CV_NORMAL);
    if (flag < 0) count = flag;
    for (int i = 0; i < n; i++) rows[k * n + i] = N_VGetArrayPointer(y)[i];
  }
  if (count >= 0) {
    long more = 0;
    CVodeGetNumRhsEvals(solver, &count);
    CVodeGetNumLinRhsEvals(solver, &more);
    CVodeGetNumSteps(solver, steps);
    count += more;
  }
  CVodeFree(&solver);
  SUNLinSolFree(linear);
  SUNMatDestroy(matrix);
  N_VDestroy(y);
  SUNContext_Free(&context);
  return count;
}
