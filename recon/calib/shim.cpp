#include "recon/calib/shim.h"

#include <memory>
#include <utility>
#include <vector>

#include <ceres/ceres.h>
#include <glog/logging.h>
#include <opencv2/calib3d.hpp>

#include "base/guarded.hpp"

namespace
{

/* Runs f(); of what OpenCV throws the sentence is enough. */
template <typename F> int calib_guarded(char *err, size_t err_size, F f) noexcept
{
    return guarded(err, err_size, [&]() -> int {
        try {
            return f();
        } catch (const cv::Exception &e) {
            return fail(PVX_EINVAL, err, err_size, e.err.c_str());
        }
    });
}

/* One term, evaluated by the C function of the problem. */
class Term : public ceres::CostFunction
{
  public:
    Term(const rec_nls &p, size_t i) : p_(p), i_(i)
    {
        set_num_residuals(2);
        for (int k = 0; k < p.term[i].n_blocks; k++)
            mutable_parameter_block_sizes()->push_back(p.block[p.term[i].block[k]].n);
    }
    bool Evaluate(double const *const *x, double *r, double **J) const override
    {
        return p_.residual(p_.ctx, i_, x, r, J);
    }

  private:
    const rec_nls &p_;
    size_t i_;
};

std::unique_ptr<ceres::Problem> build(const rec_nls &p)
{
    auto problem = std::make_unique<ceres::Problem>();
    std::vector<bool> used(p.n_blocks);
    for (size_t i = 0; i < p.n_terms; i++) {
        const rec_nls_term &t = p.term[i];
        std::vector<double *> x;
        for (int k = 0; k < t.n_blocks; k++) {
            x.push_back(p.block[t.block[k]].x);
            used[t.block[k]] = true;
        }
        problem->AddResidualBlock(new Term(p, i),
                                  t.robust ? new ceres::CauchyLoss(p.loss) : nullptr, x);
    }
    for (size_t b = 0; b < p.n_blocks; b++) {
        const rec_nls_block &k = p.block[b];
        std::vector<int> held;
        for (int i = 0; i < k.n; i++)
            if ((k.held >> i & 1) != 0)
                held.push_back(i);
        if (!used[b] || held.empty())
            continue;
        if (static_cast<int>(held.size()) == k.n)
            problem->SetParameterBlockConstant(k.x);
        else
            problem->SetManifold(k.x, new ceres::SubsetManifold(k.n, held));
    }
    return problem;
}

int solve(const rec_nls *p, rec_nls_report *out, char *err, size_t err_size) noexcept
{
    return calib_guarded(err, err_size, [&]() -> int {
        auto problem = build(*p);
        ceres::Solver::Options o;
        o.linear_solver_type = ceres::DENSE_SCHUR;
        o.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
        for (size_t b = 0; b < p->n_blocks; b++)
            if (problem->HasParameterBlock(p->block[b].x))
                o.linear_solver_ordering->AddElementToGroup(p->block[b].x,
                                                            p->block[b].first ? 0 : 1);
        o.num_threads = 1;
        o.max_num_iterations = p->max_iterations;
        o.function_tolerance = p->tolerance;
        o.initial_trust_region_radius = 1e8; /* the start is near: nearly Gauss-Newton */
        o.parameter_tolerance = 1e-10;
        o.gradient_tolerance = 1e-12;
        o.logging_type = ceres::SILENT;
        ceres::Solver::Summary s;
        ceres::Solve(o, problem.get(), &s);
        if (!s.IsSolutionUsable())
            return fail(PVX_EINVAL, err, err_size, s.message.c_str());
        *out = {s.initial_cost, s.final_cost, static_cast<int>(s.iterations.size()),
                s.termination_type == ceres::CONVERGENCE};
        return PVX_OK;
    });
}

int covariance(const rec_nls *p, const uint32_t *list, size_t n, double *cov, char *err,
               size_t err_size) noexcept
{
    return calib_guarded(err, err_size, [&]() -> int {
        auto problem = build(*p);
        std::vector<const double *> blocks;
        for (size_t i = 0; i < n; i++) {
            const rec_nls_block &b = p->block[list[i]];
            if (!problem->HasParameterBlock(b.x)) { /* nothing depends on it */
                problem->AddParameterBlock(b.x, b.n);
                problem->SetParameterBlockConstant(b.x);
            }
            blocks.push_back(b.x);
        }
        ceres::Covariance::Options o;
        o.algorithm_type = ceres::SPARSE_QR;
        o.num_threads = 1;
        ceres::Covariance c(o);
        if (!c.Compute(blocks, problem.get()) || !c.GetCovarianceMatrix(blocks, cov))
            return fail(PVX_EINVAL, err, err_size, "the covariance is singular");
        return PVX_OK;
    });
}

cv::Mat points(const double *p, size_t n)
{
    return {static_cast<int>(n), 1, CV_64FC2, const_cast<double *>(p)};
}

int homography(const double *plane, const double *pixels, size_t n, double reach, double *H,
               char *err, size_t err_size) noexcept
{
    return calib_guarded(err, err_size, [&]() -> int {
        cv::Mat h = cv::findHomography(points(plane, n), points(pixels, n), cv::RANSAC, reach);
        if (h.rows != 3 || h.cols != 3 || h.type() != CV_64F)
            return fail(PVX_EINVAL, err, err_size, "no homography");
        for (int i = 0; i < 9; i++)
            H[i] = h.at<double>(i / 3, i % 3);
        return PVX_OK;
    });
}

int planar(const double *plane, const double *ideal, size_t n, double *pose, int *n_poses,
           char *err, size_t err_size) noexcept
{
    return calib_guarded(err, err_size, [&]() -> int {
        std::vector<cv::Point3d> object;
        for (size_t i = 0; i < n; i++)
            object.emplace_back(plane[2 * i], plane[2 * i + 1], 0.0);
        std::vector<cv::Mat> r, t;
        *n_poses =
            cv::solvePnPGeneric(object, points(ideal, n), cv::Matx33d::eye(), cv::noArray(), r, t,
                                false, cv::SOLVEPNP_IPPE, cv::noArray(), cv::noArray());
        if (*n_poses > 2)
            *n_poses = 2;
        for (int k = 0; k < *n_poses; k++)
            for (int i = 0; i < 3; i++) {
                pose[6 * k + i] = r[static_cast<size_t>(k)].at<double>(i);
                pose[6 * k + 3 + i] = t[static_cast<size_t>(k)].at<double>(i);
            }
        return *n_poses > 0 ? PVX_OK : fail(PVX_EINVAL, err, err_size, "no pose");
    });
}

const rec_calib_lib lib = {REC_CALIB_VERSION, solve, covariance, homography, planar};

} // namespace

const rec_calib_lib *rec_calib_module(void) noexcept
{
    FLAGS_minloglevel = google::GLOG_FATAL; /* errors are returned, not printed */
    FLAGS_logtostderr = true;               /* and no log files are written */
    return &lib;
}
