"""Messages from ros2.idl, written by `msbot idl`."""

from __future__ import annotations

from typing import Annotated

from msbot import (
    AtMost,
    Exactly,
    Message,
    float32,
    float64,
    int8,
    int16,
    int32,
    int64,
    uint8,
    uint16,
    uint32,
    uint64,
)


class Time(Message):
    """A point in time."""

    type_name = "builtin_interfaces::msg::dds_::Time_"

    sec: int32
    nanosec: uint32


class Duration(Message):
    """A span of time."""

    type_name = "builtin_interfaces::msg::dds_::Duration_"

    sec: int32
    nanosec: uint32


class Bool(Message):
    """`std_msgs::msg::Bool`."""

    type_name = "std_msgs::msg::dds_::Bool_"

    data: bool


class Byte(Message):
    """`std_msgs::msg::Byte`."""

    type_name = "std_msgs::msg::dds_::Byte_"

    data: uint8


class Char(Message):
    """`std_msgs::msg::Char`."""

    type_name = "std_msgs::msg::dds_::Char_"

    data: uint8


class ColorRGBA(Message):
    """`std_msgs::msg::ColorRGBA`."""

    type_name = "std_msgs::msg::dds_::ColorRGBA_"

    r: float32
    g: float32
    b: float32
    a: float32


class Empty(Message):
    """`std_msgs::msg::Empty`."""

    type_name = "std_msgs::msg::dds_::Empty_"

    structure_needs_at_least_one_member: uint8


class Float32(Message):
    """`std_msgs::msg::Float32`."""

    type_name = "std_msgs::msg::dds_::Float32_"

    data: float32


class Float64(Message):
    """`std_msgs::msg::Float64`."""

    type_name = "std_msgs::msg::dds_::Float64_"

    data: float64


class Int8(Message):
    """`std_msgs::msg::Int8`."""

    type_name = "std_msgs::msg::dds_::Int8_"

    data: int8


class Int16(Message):
    """`std_msgs::msg::Int16`."""

    type_name = "std_msgs::msg::dds_::Int16_"

    data: int16


class Int32(Message):
    """`std_msgs::msg::Int32`."""

    type_name = "std_msgs::msg::dds_::Int32_"

    data: int32


class Int64(Message):
    """`std_msgs::msg::Int64`."""

    type_name = "std_msgs::msg::dds_::Int64_"

    data: int64


class UInt8(Message):
    """`std_msgs::msg::UInt8`."""

    type_name = "std_msgs::msg::dds_::UInt8_"

    data: uint8


class UInt16(Message):
    """`std_msgs::msg::UInt16`."""

    type_name = "std_msgs::msg::dds_::UInt16_"

    data: uint16


class UInt32(Message):
    """`std_msgs::msg::UInt32`."""

    type_name = "std_msgs::msg::dds_::UInt32_"

    data: uint32


class UInt64(Message):
    """`std_msgs::msg::UInt64`."""

    type_name = "std_msgs::msg::dds_::UInt64_"

    data: uint64


class String(Message):
    """`std_msgs::msg::String`."""

    type_name = "std_msgs::msg::dds_::String_"

    data: str


class Header(Message):
    """When something was seen, and in which coordinate frame."""

    type_name = "std_msgs::msg::dds_::Header_"

    stamp: Time
    frame_id: str


class MultiArrayDimension(Message):
    """`std_msgs::msg::MultiArrayDimension`."""

    type_name = "std_msgs::msg::dds_::MultiArrayDimension_"

    label: str
    size: uint32
    stride: uint32


class MultiArrayLayout(Message):
    """`std_msgs::msg::MultiArrayLayout`."""

    type_name = "std_msgs::msg::dds_::MultiArrayLayout_"

    dim: list[MultiArrayDimension]
    data_offset: uint32


class Float32MultiArray(Message):
    """`std_msgs::msg::Float32MultiArray`."""

    type_name = "std_msgs::msg::dds_::Float32MultiArray_"

    layout: MultiArrayLayout
    data: list[float32]


class Float64MultiArray(Message):
    """`std_msgs::msg::Float64MultiArray`."""

    type_name = "std_msgs::msg::dds_::Float64MultiArray_"

    layout: MultiArrayLayout
    data: list[float64]


class Int32MultiArray(Message):
    """`std_msgs::msg::Int32MultiArray`."""

    type_name = "std_msgs::msg::dds_::Int32MultiArray_"

    layout: MultiArrayLayout
    data: list[int32]


class UInt8MultiArray(Message):
    """`std_msgs::msg::UInt8MultiArray`."""

    type_name = "std_msgs::msg::dds_::UInt8MultiArray_"

    layout: MultiArrayLayout
    data: bytes


class Vector3(Message):
    """`geometry_msgs::msg::Vector3`."""

    type_name = "geometry_msgs::msg::dds_::Vector3_"

    x: float64
    y: float64
    z: float64


class Vector3Stamped(Message):
    """`geometry_msgs::msg::Vector3Stamped`."""

    type_name = "geometry_msgs::msg::dds_::Vector3Stamped_"

    header: Header
    vector: Vector3


class Point(Message):
    """`geometry_msgs::msg::Point`."""

    type_name = "geometry_msgs::msg::dds_::Point_"

    x: float64
    y: float64
    z: float64


class Point32(Message):
    """`geometry_msgs::msg::Point32`."""

    type_name = "geometry_msgs::msg::dds_::Point32_"

    x: float32
    y: float32
    z: float32


class PointStamped(Message):
    """`geometry_msgs::msg::PointStamped`."""

    type_name = "geometry_msgs::msg::dds_::PointStamped_"

    header: Header
    point: Point


class Polygon(Message):
    """`geometry_msgs::msg::Polygon`."""

    type_name = "geometry_msgs::msg::dds_::Polygon_"

    points: list[Point32]


class Quaternion(Message):
    """`geometry_msgs::msg::Quaternion`."""

    type_name = "geometry_msgs::msg::dds_::Quaternion_"

    x: float64
    y: float64
    z: float64
    w: float64


class Pose(Message):
    """`geometry_msgs::msg::Pose`."""

    type_name = "geometry_msgs::msg::dds_::Pose_"

    position: Point
    orientation: Quaternion


class Pose2D(Message):
    """`geometry_msgs::msg::Pose2D`."""

    type_name = "geometry_msgs::msg::dds_::Pose2D_"

    x: float64
    y: float64
    theta: float64


class PoseStamped(Message):
    """`geometry_msgs::msg::PoseStamped`."""

    type_name = "geometry_msgs::msg::dds_::PoseStamped_"

    header: Header
    pose: Pose


class PoseWithCovariance(Message):
    """`geometry_msgs::msg::PoseWithCovariance`."""

    type_name = "geometry_msgs::msg::dds_::PoseWithCovariance_"

    pose: Pose
    covariance: Annotated[list[float64], Exactly(36)]


class Transform(Message):
    """`geometry_msgs::msg::Transform`."""

    type_name = "geometry_msgs::msg::dds_::Transform_"

    translation: Vector3
    rotation: Quaternion


class TransformStamped(Message):
    """`geometry_msgs::msg::TransformStamped`."""

    type_name = "geometry_msgs::msg::dds_::TransformStamped_"

    header: Header
    child_frame_id: str
    transform: Transform


class Twist(Message):
    """How fast something moves and turns: m/s and rad/s."""

    type_name = "geometry_msgs::msg::dds_::Twist_"

    linear: Vector3
    angular: Vector3


class TwistStamped(Message):
    """`geometry_msgs::msg::TwistStamped`."""

    type_name = "geometry_msgs::msg::dds_::TwistStamped_"

    header: Header
    twist: Twist


class TwistWithCovariance(Message):
    """`geometry_msgs::msg::TwistWithCovariance`."""

    type_name = "geometry_msgs::msg::dds_::TwistWithCovariance_"

    twist: Twist
    covariance: Annotated[list[float64], Exactly(36)]


class Accel(Message):
    """`geometry_msgs::msg::Accel`."""

    type_name = "geometry_msgs::msg::dds_::Accel_"

    linear: Vector3
    angular: Vector3


class Wrench(Message):
    """`geometry_msgs::msg::Wrench`."""

    type_name = "geometry_msgs::msg::dds_::Wrench_"

    force: Vector3
    torque: Vector3


class BatteryState(Message):
    """`sensor_msgs::msg::BatteryState`."""

    type_name = "sensor_msgs::msg::dds_::BatteryState_"

    header: Header
    voltage: float32
    temperature: float32
    current: float32
    charge: float32
    capacity: float32
    design_capacity: float32
    percentage: float32
    power_supply_status: uint8
    power_supply_health: uint8
    power_supply_technology: uint8
    present: bool
    cell_voltage: list[float32]
    cell_temperature: list[float32]
    location: str
    serial_number: str


class FluidPressure(Message):
    """`sensor_msgs::msg::FluidPressure`."""

    type_name = "sensor_msgs::msg::dds_::FluidPressure_"

    header: Header
    fluid_pressure: float64
    variance: float64


class Illuminance(Message):
    """`sensor_msgs::msg::Illuminance`."""

    type_name = "sensor_msgs::msg::dds_::Illuminance_"

    header: Header
    illuminance: float64
    variance: float64


class RelativeHumidity(Message):
    """`sensor_msgs::msg::RelativeHumidity`."""

    type_name = "sensor_msgs::msg::dds_::RelativeHumidity_"

    header: Header
    relative_humidity: float64
    variance: float64


class Temperature(Message):
    """`sensor_msgs::msg::Temperature`."""

    type_name = "sensor_msgs::msg::dds_::Temperature_"

    header: Header
    temperature: float64
    variance: float64


class MagneticField(Message):
    """`sensor_msgs::msg::MagneticField`."""

    type_name = "sensor_msgs::msg::dds_::MagneticField_"

    header: Header
    magnetic_field: Vector3
    magnetic_field_covariance: Annotated[list[float64], Exactly(9)]


class Imu(Message):
    """Orientation, turning rate in rad/s, acceleration in m/s2, each with its covariance by rows."""

    type_name = "sensor_msgs::msg::dds_::Imu_"

    header: Header
    orientation: Quaternion
    orientation_covariance: Annotated[list[float64], Exactly(9)]
    angular_velocity: Vector3
    angular_velocity_covariance: Annotated[list[float64], Exactly(9)]
    linear_acceleration: Vector3
    linear_acceleration_covariance: Annotated[list[float64], Exactly(9)]


class JointState(Message):
    """`sensor_msgs::msg::JointState`."""

    type_name = "sensor_msgs::msg::dds_::JointState_"

    header: Header
    name: list[str]
    position: list[float64]
    velocity: list[float64]
    effort: list[float64]


class Joy(Message):
    """`sensor_msgs::msg::Joy`."""

    type_name = "sensor_msgs::msg::dds_::Joy_"

    header: Header
    axes: list[float32]
    buttons: list[int32]


class LaserScan(Message):
    """One turn of a laser scanner: angles in rad, distances in m."""

    type_name = "sensor_msgs::msg::dds_::LaserScan_"

    header: Header
    angle_min: float32
    angle_max: float32
    angle_increment: float32
    time_increment: float32
    scan_time: float32
    range_min: float32
    range_max: float32
    ranges: list[float32]
    intensities: list[float32]


class Range(Message):
    """`sensor_msgs::msg::Range`."""

    type_name = "sensor_msgs::msg::dds_::Range_"

    header: Header
    radiation_type: uint8
    field_of_view: float32
    min_range: float32
    max_range: float32
    range: float32
    variance: float32


class Image(Message):
    """`sensor_msgs::msg::Image`."""

    type_name = "sensor_msgs::msg::dds_::Image_"

    header: Header
    height: uint32
    width: uint32
    encoding: str
    is_bigendian: uint8
    step: uint32
    data: bytes


class CompressedImage(Message):
    """`sensor_msgs::msg::CompressedImage`."""

    type_name = "sensor_msgs::msg::dds_::CompressedImage_"

    header: Header
    format: str
    data: bytes


class RegionOfInterest(Message):
    """`sensor_msgs::msg::RegionOfInterest`."""

    type_name = "sensor_msgs::msg::dds_::RegionOfInterest_"

    x_offset: uint32
    y_offset: uint32
    height: uint32
    width: uint32
    do_rectify: bool


class CameraInfo(Message):
    """`sensor_msgs::msg::CameraInfo`."""

    type_name = "sensor_msgs::msg::dds_::CameraInfo_"

    header: Header
    height: uint32
    width: uint32
    distortion_model: str
    d: list[float64]
    k: Annotated[list[float64], Exactly(9)]
    r: Annotated[list[float64], Exactly(9)]
    p: Annotated[list[float64], Exactly(12)]
    binning_x: uint32
    binning_y: uint32
    roi: RegionOfInterest


class NavSatStatus(Message):
    """`sensor_msgs::msg::NavSatStatus`."""

    type_name = "sensor_msgs::msg::dds_::NavSatStatus_"

    status: int8
    service: uint16


class NavSatFix(Message):
    """`sensor_msgs::msg::NavSatFix`."""

    type_name = "sensor_msgs::msg::dds_::NavSatFix_"

    header: Header
    status: NavSatStatus
    latitude: float64
    longitude: float64
    altitude: float64
    position_covariance: Annotated[list[float64], Exactly(9)]
    position_covariance_type: uint8


class PointField(Message):
    """`sensor_msgs::msg::PointField`."""

    type_name = "sensor_msgs::msg::dds_::PointField_"

    name: str
    offset: uint32
    datatype: uint8
    count: uint32


class PointCloud2(Message):
    """`sensor_msgs::msg::PointCloud2`."""

    type_name = "sensor_msgs::msg::dds_::PointCloud2_"

    header: Header
    height: uint32
    width: uint32
    fields: list[PointField]
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: bytes
    is_dense: bool


class MapMetaData(Message):
    """`nav_msgs::msg::MapMetaData`."""

    type_name = "nav_msgs::msg::dds_::MapMetaData_"

    map_load_time: Time
    resolution: float32
    width: uint32
    height: uint32
    origin: Pose


class OccupancyGrid(Message):
    """`nav_msgs::msg::OccupancyGrid`."""

    type_name = "nav_msgs::msg::dds_::OccupancyGrid_"

    header: Header
    info: MapMetaData
    data: list[int8]


class Odometry(Message):
    """`nav_msgs::msg::Odometry`."""

    type_name = "nav_msgs::msg::dds_::Odometry_"

    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance


class Path(Message):
    """`nav_msgs::msg::Path`."""

    type_name = "nav_msgs::msg::dds_::Path_"

    header: Header
    poses: list[PoseStamped]


class KeyValue(Message):
    """`diagnostic_msgs::msg::KeyValue`."""

    type_name = "diagnostic_msgs::msg::dds_::KeyValue_"

    key: str
    value: str


class DiagnosticStatus(Message):
    """`diagnostic_msgs::msg::DiagnosticStatus`."""

    type_name = "diagnostic_msgs::msg::dds_::DiagnosticStatus_"

    level: uint8
    name: str
    message: str
    hardware_id: str
    values: list[KeyValue]


class DiagnosticArray(Message):
    """`diagnostic_msgs::msg::DiagnosticArray`."""

    type_name = "diagnostic_msgs::msg::dds_::DiagnosticArray_"

    header: Header
    status: list[DiagnosticStatus]


class Clock(Message):
    """`rosgraph_msgs::msg::Clock`."""

    type_name = "rosgraph_msgs::msg::dds_::Clock_"

    clock: Time


class FloatingPointRange(Message):
    """The bounds of a parameter, both included."""

    type_name = "rcl_interfaces::msg::dds_::FloatingPointRange_"

    from_value: float64
    to_value: float64
    step: float64


class IntegerRange(Message):
    """`rcl_interfaces::msg::IntegerRange`."""

    type_name = "rcl_interfaces::msg::dds_::IntegerRange_"

    from_value: int64
    to_value: int64
    step: uint64


class ParameterDescriptor(Message):
    """`rcl_interfaces::msg::ParameterDescriptor`."""

    type_name = "rcl_interfaces::msg::dds_::ParameterDescriptor_"

    name: str
    type: uint8
    description: str
    additional_constraints: str
    read_only: bool
    dynamic_typing: bool
    floating_point_range: Annotated[list[FloatingPointRange], AtMost(1)]
    integer_range: Annotated[list[IntegerRange], AtMost(1)]


class ParameterValue(Message):
    """The field that counts is the one that `type` names."""

    type_name = "rcl_interfaces::msg::dds_::ParameterValue_"

    type: uint8
    bool_value: bool
    integer_value: int64
    double_value: float64
    string_value: str
    byte_array_value: bytes
    bool_array_value: list[bool]
    integer_array_value: list[int64]
    double_array_value: list[float64]
    string_array_value: list[str]


class Parameter(Message):
    """`rcl_interfaces::msg::Parameter`."""

    type_name = "rcl_interfaces::msg::dds_::Parameter_"

    name: str
    value: ParameterValue


class ParameterEvent(Message):
    """`rcl_interfaces::msg::ParameterEvent`."""

    type_name = "rcl_interfaces::msg::dds_::ParameterEvent_"

    stamp: Time
    node: str
    new_parameters: list[Parameter]
    changed_parameters: list[Parameter]
    deleted_parameters: list[Parameter]


class SetParametersResult(Message):
    """`rcl_interfaces::msg::SetParametersResult`."""

    type_name = "rcl_interfaces::msg::dds_::SetParametersResult_"

    successful: bool
    reason: str


class ListParametersResult(Message):
    """`rcl_interfaces::msg::ListParametersResult`."""

    type_name = "rcl_interfaces::msg::dds_::ListParametersResult_"

    names: list[str]
    prefixes: list[str]


class Log(Message):
    """A line of /rosout: `level` is 10 (debug), 20 (info), 30 (warning), 40 (error) or 50 (fatal)."""

    type_name = "rcl_interfaces::msg::dds_::Log_"

    stamp: Time
    level: uint8
    name: str
    msg: str
    file: str
    function: str
    line: uint32


class DescribeParameters_Request(Message):
    """`rcl_interfaces::srv::DescribeParameters_Request`."""

    type_name = "rcl_interfaces::srv::dds_::DescribeParameters_Request_"

    names: list[str]


class DescribeParameters_Response(Message):
    """`rcl_interfaces::srv::DescribeParameters_Response`."""

    type_name = "rcl_interfaces::srv::dds_::DescribeParameters_Response_"

    descriptors: list[ParameterDescriptor]


class GetParameters_Request(Message):
    """`rcl_interfaces::srv::GetParameters_Request`."""

    type_name = "rcl_interfaces::srv::dds_::GetParameters_Request_"

    names: list[str]


class GetParameters_Response(Message):
    """`rcl_interfaces::srv::GetParameters_Response`."""

    type_name = "rcl_interfaces::srv::dds_::GetParameters_Response_"

    values: list[ParameterValue]


class GetParameterTypes_Request(Message):
    """`rcl_interfaces::srv::GetParameterTypes_Request`."""

    type_name = "rcl_interfaces::srv::dds_::GetParameterTypes_Request_"

    names: list[str]


class GetParameterTypes_Response(Message):
    """`rcl_interfaces::srv::GetParameterTypes_Response`."""

    type_name = "rcl_interfaces::srv::dds_::GetParameterTypes_Response_"

    types: bytes


class ListParameters_Request(Message):
    """`rcl_interfaces::srv::ListParameters_Request`."""

    type_name = "rcl_interfaces::srv::dds_::ListParameters_Request_"

    prefixes: list[str]
    depth: uint64


class ListParameters_Response(Message):
    """`rcl_interfaces::srv::ListParameters_Response`."""

    type_name = "rcl_interfaces::srv::dds_::ListParameters_Response_"

    result: ListParametersResult


class SetParameters_Request(Message):
    """`rcl_interfaces::srv::SetParameters_Request`."""

    type_name = "rcl_interfaces::srv::dds_::SetParameters_Request_"

    parameters: list[Parameter]


class SetParameters_Response(Message):
    """`rcl_interfaces::srv::SetParameters_Response`."""

    type_name = "rcl_interfaces::srv::dds_::SetParameters_Response_"

    results: list[SetParametersResult]


class SetParametersAtomically_Request(Message):
    """`rcl_interfaces::srv::SetParametersAtomically_Request`."""

    type_name = "rcl_interfaces::srv::dds_::SetParametersAtomically_Request_"

    parameters: list[Parameter]


class SetParametersAtomically_Response(Message):
    """`rcl_interfaces::srv::SetParametersAtomically_Response`."""

    type_name = "rcl_interfaces::srv::dds_::SetParametersAtomically_Response_"

    result: SetParametersResult


class Empty_Request(Message):
    """ROS 2 has no message without a field."""

    type_name = "std_srvs::srv::dds_::Empty_Request_"

    structure_needs_at_least_one_member: uint8


class Empty_Response(Message):
    """`std_srvs::srv::Empty_Response`."""

    type_name = "std_srvs::srv::dds_::Empty_Response_"

    structure_needs_at_least_one_member: uint8


class SetBool_Request(Message):
    """`std_srvs::srv::SetBool_Request`."""

    type_name = "std_srvs::srv::dds_::SetBool_Request_"

    data: bool


class SetBool_Response(Message):
    """`std_srvs::srv::SetBool_Response`."""

    type_name = "std_srvs::srv::dds_::SetBool_Response_"

    success: bool
    message: str


class Trigger_Request(Message):
    """`std_srvs::srv::Trigger_Request`."""

    type_name = "std_srvs::srv::dds_::Trigger_Request_"

    structure_needs_at_least_one_member: uint8


class Trigger_Response(Message):
    """`std_srvs::srv::Trigger_Response`."""

    type_name = "std_srvs::srv::dds_::Trigger_Response_"

    success: bool
    message: str
