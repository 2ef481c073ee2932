// An exported controller as a ros2_control plugin: a template, not built by its project. The logic is in C: controller/.
#include <cmath>
#include <mutex>
#include <string>
#include <vector>

#include "controller.h"
#include "controller_buffer.h"
#include "controller_interface/controller_interface.hpp"
#include "nav_msgs/msg/odometry.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "realtime_tools/realtime_buffer.hpp"
#include "trajectory_msgs/msg/joint_trajectory.hpp"

namespace wmr_controller
{
using controller_interface::CallbackReturn;
using controller_interface::InterfaceConfiguration;
using controller_interface::return_type;
using nav_msgs::msg::Odometry;
using trajectory_msgs::msg::JointTrajectory;

struct Measured
{
  rclcpp::Time stamp{0, 0, RCL_ROS_TIME};
  controller_real x[CONTROLLER_X] = {};
};

class WmrController : public controller_interface::ControllerInterface
{
public:
  CallbackReturn on_init() override
  {
    auto_declare<std::vector<std::string>>("motors", {});  // command interfaces, in the order of u
    auto_declare<double>("measurement_timeout", 0.1);      // [s]; an older pose gives no voltage
    auto_declare<double>("setpoint_timeout", 0.5);         // [s]; then the outputs come to rest
    auto_declare<double>("stop", 1.0);                     // [s]
    return CallbackReturn::SUCCESS;
  }

  InterfaceConfiguration command_interface_configuration() const override
  {
    return {controller_interface::interface_configuration_type::INDIVIDUAL, motors_};
  }

  InterfaceConfiguration state_interface_configuration() const override
  {
    return {controller_interface::interface_configuration_type::NONE, {}};
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State &) override
  {
    motors_ = get_node()->get_parameter("motors").as_string_array();
    if (motors_.size() != CONTROLLER_U) {
      RCLCPP_ERROR(get_node()->get_logger(), "%zu motors; give the %d of the exported README", motors_.size(),
        static_cast<int>(CONTROLLER_U));
      return CallbackReturn::ERROR;
    }
    measurement_timeout_ = get_node()->get_parameter("measurement_timeout").as_double();
    odometry_ = get_node()->create_subscription<Odometry>(
      "~/odometry", rclcpp::SystemDefaultsQoS(), [this](const Odometry & message) {odometry(message);});
    setpoints_ = get_node()->create_subscription<JointTrajectory>(
      "~/setpoints", rclcpp::SystemDefaultsQoS(), [this](const JointTrajectory & message) {setpoints(message);});
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State &) override
  {
    const auto us = [this](const char * name) {
        return static_cast<uint32_t>(1e6 * get_node()->get_parameter(name).as_double());
      };
    std::lock_guard<std::mutex> lock(mutex_);
    controller_init(&state_);
    controller_buffer_init(&buffer_, us("setpoint_timeout"), us("stop"));
    measured_.writeFromNonRT(Measured());  // what was measured before does not count
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State &) override
  {
    stop();
    return CallbackReturn::SUCCESS;
  }

  return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) override
  {
    const Measured & measured = *measured_.readFromRT();
    controller_setpoint reference;
    controller_real u[CONTROLLER_U] = {};
    std::unique_lock<std::mutex> lock(mutex_, std::try_to_lock);  // a setpoint that is just pushed waits, not the loop
    if (lock.owns_lock()) {
      has_reference_ = controller_buffer_at(&buffer_, microseconds(time), &reference_) != CONTROLLER_BUFFER_EMPTY;
    }
    reference = reference_;
    const bool is_fresh = measured.stamp.nanoseconds() > 0 && (time - measured.stamp).seconds() < measurement_timeout_;
    if (!has_reference_ || !is_fresh) {
      stop();
      return return_type::OK;
    }
    const controller_status status = controller_step(
      &state_, static_cast<controller_real>(period.seconds()), measured.x, &reference, u, nullptr);
    for (size_t i = 0; i < CONTROLLER_U; i++) {
      (void)command_interfaces_[i].set_value(static_cast<double>(u[i]));  // zero unless the status is OK
    }
    return status == CONTROLLER_OK ? return_type::OK : return_type::ERROR;
  }

private:
  static uint32_t microseconds(const rclcpp::Time & time)
  {
    return static_cast<uint32_t>(time.nanoseconds() / 1000);  // wraps, as the buffer allows
  }

  void stop()
  {
    for (auto & motor : command_interfaces_) {
      (void)motor.set_value(0.0);
    }
  }

  void odometry(const Odometry & message)  // of a differential drive
  {
    const auto & q = message.pose.pose.orientation;
    const double yaw = std::atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
    heading_ += std::remainder(yaw - heading_, 2.0 * M_PI);  // goes on over half a turn
    Measured measured;
    measured.stamp = message.header.stamp;
    measured.x[CONTROLLER_X_x] = static_cast<controller_real>(message.pose.pose.position.x);
    measured.x[CONTROLLER_X_y] = static_cast<controller_real>(message.pose.pose.position.y);
    measured.x[CONTROLLER_X_phi] = static_cast<controller_real>(heading_);
    measured.x[CONTROLLER_X_v] = static_cast<controller_real>(message.twist.twist.linear.x);
    measured.x[CONTROLLER_X_omega] = static_cast<controller_real>(message.twist.twist.angular.z);
    measured_.writeFromNonRT(measured);
  }

  void setpoints(const JointTrajectory & message)
  {
    for (const auto & point : message.points) {
      if (point.positions.size() != CONTROLLER_Y || point.velocities.size() != CONTROLLER_Y ||
        point.accelerations.size() != CONTROLLER_Y)
      {
        RCLCPP_WARN(get_node()->get_logger(), "a setpoint without all of its numbers was left out");
        continue;
      }
      controller_setpoint setpoint;
      for (size_t i = 0; i < CONTROLLER_Y; i++) {
        setpoint.position[i] = static_cast<controller_real>(point.positions[i]);
        setpoint.velocity[i] = static_cast<controller_real>(point.velocities[i]);
        setpoint.acceleration[i] = static_cast<controller_real>(point.accelerations[i]);
      }
      const rclcpp::Time time = rclcpp::Time(message.header.stamp) + rclcpp::Duration(point.time_from_start);
      std::lock_guard<std::mutex> lock(mutex_);
      const controller_push_status status = controller_buffer_push(&buffer_, microseconds(time), &setpoint);
      if (status != CONTROLLER_PUSH_OK) {
        RCLCPP_WARN(get_node()->get_logger(), "a setpoint was refused: %d", static_cast<int>(status));
      }
    }
  }

  std::vector<std::string> motors_;
  double measurement_timeout_ = 0.1;
  double heading_ = 0.0;
  bool has_reference_ = false;
  std::mutex mutex_;  // of the buffer
  controller_state state_;
  controller_buffer buffer_;
  controller_setpoint reference_{};
  realtime_tools::RealtimeBuffer<Measured> measured_;
  rclcpp::Subscription<Odometry>::SharedPtr odometry_;
  rclcpp::Subscription<JointTrajectory>::SharedPtr setpoints_;
};
}  // namespace wmr_controller

PLUGINLIB_EXPORT_CLASS(wmr_controller::WmrController, controller_interface::ControllerInterface)
