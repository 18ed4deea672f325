// SPDX-License-Identifier: Apache-2.0
#include "refine/shared_block.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "plumbline/geometry/se3.hpp"
#include "plumbline/geometry/so3.hpp"

namespace plumbline::detail {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

class MergedCost final : public ceres::CostFunction {
 public:
  MergedCost(std::unique_ptr<ceres::CostFunction> inner, std::vector<int> offset, int size)
      : inner_(std::move(inner)), offset_(std::move(offset)), size_(size) {
    set_num_residuals(inner_->num_residuals());
    mutable_parameter_block_sizes()->push_back(size);
    const auto& sizes = inner_->parameter_block_sizes();
    for (std::size_t b = 0; b < sizes.size(); ++b) {
      if (offset_[b] < 0) mutable_parameter_block_sizes()->push_back(sizes[b]);
    }
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    const auto& sizes = inner_->parameter_block_sizes();
    const int n = num_residuals();
    std::vector<const double*> x(sizes.size());
    std::vector<double*> J(sizes.size(), nullptr);
    std::vector<RowMajor> own(sizes.size());
    int next = 1;
    for (std::size_t b = 0; b < sizes.size(); ++b) {
      const bool merged = offset_[b] >= 0;
      x[b] = merged ? blocks[0] + offset_[b] : blocks[next];
      if (jacobians && merged && jacobians[0]) {
        own[b].resize(n, sizes[b]);
        J[b] = own[b].data();
      } else if (jacobians && !merged) {
        J[b] = jacobians[next];
      }
      next += !merged;
    }
    if (!inner_->Evaluate(x.data(), residuals, jacobians ? J.data() : nullptr)) return false;
    if (!jacobians || !jacobians[0]) return true;
    Eigen::Map<RowMajor> all(jacobians[0], n, size_);
    all.setZero();
    for (std::size_t b = 0; b < sizes.size(); ++b) {
      if (offset_[b] >= 0) all.middleCols(offset_[b], sizes[b]) = own[b];
    }
    return true;
  }

 private:
  std::unique_ptr<ceres::CostFunction> inner_;
  std::vector<int> offset_;
  int size_;
};

class TiedManifold final : public ceres::Manifold {
 public:
  TiedManifold(std::vector<std::unique_ptr<ceres::Manifold>> parts, std::vector<int> column, int n_free)
      : parts_(std::move(parts)), column_(std::move(column)), n_free_(n_free), n_of_(n_free, 0) {
    for (const auto& part : parts_) ambient_ += part->AmbientSize();
    for (int c : column_) {
      if (c >= 0) ++n_of_[c];
    }
  }
  int AmbientSize() const override { return ambient_; }
  int TangentSize() const override { return n_free_; }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    std::vector<double> d(column_.size());
    for (std::size_t i = 0; i < d.size(); ++i) d[i] = column_[i] >= 0 ? delta[column_[i]] : 0;
    return each([&](const ceres::Manifold& part, int at, int step) {
      return part.Plus(x + at, d.data() + step, x_plus_delta + at);
    });
  }
  bool PlusJacobian(const double* x, double* jacobian) const override {
    Eigen::Map<RowMajor> J(jacobian, ambient_, n_free_);
    J.setZero();
    return each([&](const ceres::Manifold& part, int at, int step) {
      RowMajor own(part.AmbientSize(), part.TangentSize());
      if (!part.PlusJacobian(x + at, own.data())) return false;
      for (int i = 0; i < own.cols(); ++i) {
        const int c = column_[step + i];
        if (c >= 0) J.col(c).segment(at, own.rows()) += own.col(i);
      }
      return true;
    });
  }
  // The mean over those that move together.
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    std::fill_n(y_minus_x, n_free_, 0.0);
    return each([&](const ceres::Manifold& part, int at, int step) {
      std::vector<double> d(static_cast<std::size_t>(part.TangentSize()));
      if (!part.Minus(y + at, x + at, d.data())) return false;
      for (std::size_t i = 0; i < d.size(); ++i) {
        const int c = column_[static_cast<std::size_t>(step) + i];
        if (c >= 0) y_minus_x[c] += d[i] / n_of_[c];
      }
      return true;
    });
  }
  bool MinusJacobian(const double* x, double* jacobian) const override {
    Eigen::Map<RowMajor> J(jacobian, n_free_, ambient_);
    J.setZero();
    return each([&](const ceres::Manifold& part, int at, int step) {
      RowMajor own(part.TangentSize(), part.AmbientSize());
      if (!part.MinusJacobian(x + at, own.data())) return false;
      for (int i = 0; i < own.rows(); ++i) {
        const int c = column_[step + i];
        if (c >= 0) J.row(c).segment(at, own.cols()) += own.row(i) / n_of_[c];
      }
      return true;
    });
  }

 private:
  template <class Visit>
  bool each(Visit&& visit) const {
    int at = 0, step = 0;
    for (const auto& part : parts_) {
      if (!visit(*part, at, step)) return false;
      at += part->AmbientSize();
      step += part->TangentSize();
    }
    return true;
  }
  std::vector<std::unique_ptr<ceres::Manifold>> parts_;
  std::vector<int> column_;
  int n_free_, ambient_ = 0;
  std::vector<int> n_of_;
};

class PriorCost final : public ceres::CostFunction {
 public:
  PriorCost(int size, int i, double value, double weight) : i_(i), value_(value), weight_(weight) {
    set_num_residuals(1);
    *mutable_parameter_block_sizes() = {size};
  }
  bool Evaluate(double const* const* x, double* r, double** J) const override {
    r[0] = weight_ * (x[0][i_] - value_);
    if (!J || !J[0]) return true;
    std::fill_n(J[0], parameter_block_sizes()[0], 0.0);
    J[0][i_] = weight_;
    return true;
  }

 private:
  int i_;
  double value_, weight_;
};

class PosePriorCost final : public ceres::CostFunction {
 public:
  PosePriorCost(int i, double value, double weight) : i_(i), value_(value), weight_(weight) {
    set_num_residuals(1);
    *mutable_parameter_block_sizes() = {7};
  }
  bool Evaluate(double const* const* x, double* r, double** J) const override {
    SE3 T;
    std::copy_n(x[0], 7, T.qt.begin());
    const Vec3 w = so3_log(T.R()), t = T.t();
    r[0] = weight_ * ((i_ < 3 ? w[i_] : t[i_ - 3]) - value_);
    if (!J || !J[0]) return true;
    std::fill_n(J[0], 7, 0.0);
    if (i_ >= 3) {
      J[0][i_] = weight_;
      return true;
    }
    // exp(dw) R has the rotation vector log(R) + J_l^-1 dw.
    const Mat3 inverse = so3_left_jacobian_inverse(w);
    for (int k = 0; k < 3; ++k) J[0][k] = weight_ * inverse(i_, k);
    return true;
  }

 private:
  int i_;
  double value_, weight_;
};

}  // namespace

std::unique_ptr<ceres::CostFunction> merge_blocks(std::unique_ptr<ceres::CostFunction> inner,
                                                  std::vector<int> offset, int size) {
  return std::make_unique<MergedCost>(std::move(inner), std::move(offset), size);
}

std::unique_ptr<ceres::Manifold> make_tied_manifold(std::vector<std::unique_ptr<ceres::Manifold>> parts,
                                                    std::vector<int> column, int n_free) {
  return std::make_unique<TiedManifold>(std::move(parts), std::move(column), n_free);
}

std::unique_ptr<ceres::CostFunction> make_prior_cost(int block_size, int i, double value, double weight) {
  return std::make_unique<PriorCost>(block_size, i, value, weight);
}

std::unique_ptr<ceres::CostFunction> make_pose_prior_cost(int i, double value, double weight) {
  return std::make_unique<PosePriorCost>(i, value, weight);
}

}  // namespace plumbline::detail
