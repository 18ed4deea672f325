// SPDX-License-Identifier: Apache-2.0
#include "plumbline/core/parallel.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <string>
#include <vector>

namespace plumbline {
namespace {

TEST(ParallelFor, CallsEachIndexOnceForAnyThreadCount) {
  for (int n_threads : {-1, 0, 1, 2, 3, 64}) {
    std::vector<std::atomic<int>> calls(1000);
    parallel_for(1000, n_threads, [&](int i) { ++calls[i]; });
    for (int i = 0; i < 1000; ++i) ASSERT_EQ(calls[i], 1) << i << " with " << n_threads << " threads";
  }
}

TEST(ParallelFor, NothingToDo) {
  parallel_for(0, 4, [](int) { FAIL(); });
  parallel_for(-3, 4, [](int) { FAIL(); });
}

TEST(ParallelFor, TheFailureOfTheSmallestIndexComesBackAfterAllHaveRun) {
  for (int n_threads : {1, 2, 8}) {
    std::atomic<int> ran{0};
    std::string caught;
    try {
      parallel_for(200, n_threads, [&](int i) {
        ++ran;
        if (i % 50 == 7) throw std::runtime_error(std::to_string(i));
      });
    } catch (const std::runtime_error& e) {
      caught = e.what();
    }
    EXPECT_EQ(caught, "7") << n_threads << " threads";
    EXPECT_EQ(ran, 200) << n_threads << " threads";
  }
}

TEST(WorkersFunction, RunManyLoopsOneAfterTheOther) {
  for (int n_threads : {0, 1, 2, 5}) {
    Workers workers(n_threads);
    std::vector<int> calls(100, 0);
    for (int loop = 0; loop < 2000; ++loop) workers.run(loop % 101, [&](int i) { ++calls[i]; });
    for (int i = 0; i < 100; ++i) {
      int expected = 0;
      for (int loop = 0; loop < 2000; ++loop) expected += i < loop % 101;
      ASSERT_EQ(calls[i], expected) << i << " with " << n_threads << " threads";
    }
  }
}

TEST(WorkersFunction, GoOnAfterAFailure) {
  Workers workers(3);
  for (int loop = 0; loop < 50; ++loop) {
    std::atomic<int> ran{0};
    std::string caught;
    try {
      workers.run(40, [&](int i) {
        ++ran;
        if (i % 10 == 3) throw std::runtime_error(std::to_string(i));
      });
    } catch (const std::runtime_error& e) {
      caught = e.what();
    }
    EXPECT_EQ(caught, "3");
    EXPECT_EQ(ran, 40);
  }
}

}  // namespace
}  // namespace plumbline
