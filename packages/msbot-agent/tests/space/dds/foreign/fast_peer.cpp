// A program with Fast DDS and a typed topic, as anybody writes it; its arguments and lines are those of cyclone_peer.c.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <thread>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

#include "HelloPubSubTypes.h"

using namespace eprosima::fastdds::dds;

template <class Qos> Qos with(Qos qos, bool reliable, bool durable)
{
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = durable ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().kind = KEEP_LAST_HISTORY_QOS;
    qos.history().depth = 100;
    return qos;
}

int main(int argc, char** argv)
{
    if (argc != 6) { std::fprintf(stderr, "five arguments are needed\n"); return 2; }
    const int count = std::atoi(argv[3]);
    const bool reliable = !std::strcmp(argv[4], "reliable"), durable = !std::strcmp(argv[5], "transient_local");
    std::setvbuf(stdout, nullptr, _IOLBF, 0);
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(0, PARTICIPANT_QOS_DEFAULT);
    TypeSupport type(new HelloWorldData::MsgPubSubType());
    type.register_type(participant);
    auto* topic = participant->create_topic(argv[2], type.get_type_name(), TOPIC_QOS_DEFAULT);
    if (!std::strcmp(argv[1], "write")) {
        auto* writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)
                           ->create_datawriter(topic, with(DATAWRITER_QOS_DEFAULT, reliable, durable));
        std::puts("ready");
        PublicationMatchedStatus matched;
        do {
            std::this_thread::sleep_for(std::chrono::milliseconds(5));
            writer->get_publication_matched_status(matched);
        } while (!durable && matched.current_count == 0);
        if (!std::strcmp(argv[5], "when_told")) for (int c = 0; c != EOF && c != '\n';) c = std::getchar();
        for (int i = 0; i < count; i++) {
            HelloWorldData::Msg message;
            message.userID(i);
            message.message("hello " + std::to_string(i));
            if (!writer->write(&message)) { std::puts("not written"); return 1; }
        }
        std::puts("wrote");
    } else {
        auto* reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)
                           ->create_datareader(topic, with(DATAREADER_QOS_DEFAULT, reliable, durable));
        std::puts("ready");
        HelloWorldData::Msg message;
        SampleInfo info;
        for (int seen = 0; seen < count;) {
            if (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
                if (info.valid_data) { std::printf("got %d %s\n", message.userID(), message.message().c_str()); seen++; }
            } else {
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
            }
        }
    }
    while (std::getchar() != EOF) {}
    participant->delete_contained_entities();
    DomainParticipantFactory::get_instance()->delete_participant(participant);
    return 0;
}
