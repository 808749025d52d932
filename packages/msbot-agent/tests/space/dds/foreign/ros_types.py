"""Messages of ROS 2 as the package `cyclonedds` has them, with the header of rmw_cyclonedds in those of services."""

# mypy: ignore-errors
from dataclasses import dataclass
from functools import partial
from types import new_class

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.types import array, sequence


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
    data: array[types.uint8, 16]


@dataclass
class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    node_namespace: str
    node_name: str
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntitiesInfo]


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: types.int32
    nanosec: types.uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Float32(IdlStruct, typename="std_msgs::msg::dds_::Float32_"):
    data: types.float32


@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: Time


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: types.uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class ParameterValue(IdlStruct, typename="rcl_interfaces::msg::dds_::ParameterValue_"):
    type: types.uint8 = 0
    bool_value: bool = False
    integer_value: types.int64 = 0
    double_value: types.float64 = 0.0
    string_value: str = ""
    byte_array_value: sequence[types.uint8] = ()
    bool_array_value: sequence[bool] = ()
    integer_array_value: sequence[types.int64] = ()
    double_array_value: sequence[types.float64] = ()
    string_array_value: sequence[str] = ()


@dataclass
class Parameter(IdlStruct, typename="rcl_interfaces::msg::dds_::Parameter_"):
    name: str
    value: ParameterValue


@dataclass
class ParameterEvent(IdlStruct, typename="rcl_interfaces::msg::dds_::ParameterEvent_"):
    stamp: Time
    node: str
    new_parameters: sequence[Parameter]
    changed_parameters: sequence[Parameter]
    deleted_parameters: sequence[Parameter]


@dataclass
class SetParametersResult(IdlStruct, typename="rcl_interfaces::msg::dds_::SetParametersResult_"):
    successful: bool
    reason: str


@dataclass
class ListParametersResult(IdlStruct, typename="rcl_interfaces::msg::dds_::ListParametersResult_"):
    names: sequence[str]
    prefixes: sequence[str]


@dataclass
class FloatingPointRange(IdlStruct, typename="rcl_interfaces::msg::dds_::FloatingPointRange_"):
    from_value: types.float64
    to_value: types.float64
    step: types.float64


@dataclass
class IntegerRange(IdlStruct, typename="rcl_interfaces::msg::dds_::IntegerRange_"):
    from_value: types.int64
    to_value: types.int64
    step: types.uint64


@dataclass
class ParameterDescriptor(IdlStruct, typename="rcl_interfaces::msg::dds_::ParameterDescriptor_"):
    name: str
    type: types.uint8
    description: str
    additional_constraints: str
    read_only: bool
    dynamic_typing: bool
    floating_point_range: sequence[FloatingPointRange, 1]
    integer_range: sequence[IntegerRange, 1]


def service(name, request, response):
    """The two types of a service, each with the requester and the number of the request in front."""
    header = {"guid": types.uint64, "seq": types.int64}
    made = []
    for half, fields in (("Request", request), ("Response", response)):
        body = {"__annotations__": {**header, **fields}, "__module__": __name__}
        options = {"typename": f"rcl_interfaces::srv::dds_::{name}_{half}_"}
        made.append(dataclass(new_class(f"{name}_{half}", (IdlStruct,), options, partial(dict.update, **body))))
    return tuple(made)


NAMES = {"names": sequence[str]}
PARAMETERS = {"parameters": sequence[Parameter]}
SERVICES = {
    "list_parameters": service(
        "ListParameters", {"prefixes": sequence[str], "depth": types.uint64}, {"result": ListParametersResult}
    ),
    "describe_parameters": service("DescribeParameters", NAMES, {"descriptors": sequence[ParameterDescriptor]}),
    "get_parameters": service("GetParameters", NAMES, {"values": sequence[ParameterValue]}),
    "get_parameter_types": service("GetParameterTypes", NAMES, {"types": sequence[types.uint8]}),
    "set_parameters": service("SetParameters", PARAMETERS, {"results": sequence[SetParametersResult]}),
    "set_parameters_atomically": service("SetParametersAtomically", PARAMETERS, {"result": SetParametersResult}),
}
