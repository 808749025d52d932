/* A program with Cyclone DDS in C and a typed topic, as anybody writes it.
   cyclone_peer write|read TOPIC COUNT reliable|best_effort volatile|when_told|transient_local
   read prints "got ID TEXT" for each sample, write prints "wrote"; both print "ready" first and end with their input.
   when_told is volatile, and nothing is written before a line of input. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "dds/dds.h"
#include "Hello.h"

int main (int argc, char **argv)
{
  if (argc != 6) { fprintf (stderr, "five arguments are needed\n"); return 2; }
  const int count = atoi (argv[3]);
  const int reliable = strcmp (argv[4], "reliable") == 0, durable = strcmp (argv[5], "transient_local") == 0;
  setvbuf (stdout, NULL, _IOLBF, 0);
  dds_entity_t participant = dds_create_participant (DDS_DOMAIN_DEFAULT, NULL, NULL);
  if (participant < 0) { printf ("no participant: %s\n", dds_strretcode (participant)); return 1; }
  dds_entity_t topic = dds_create_topic (participant, &HelloWorldData_Msg_desc, argv[2], NULL, NULL);
  dds_qos_t *qos = dds_create_qos ();
  dds_qset_reliability (qos, reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT, DDS_SECS (10));
  dds_qset_durability (qos, durable ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history (qos, DDS_HISTORY_KEEP_LAST, 100);
  if (durable) dds_qset_durability_service (qos, 0, DDS_HISTORY_KEEP_LAST, 100, -1, -1, -1);
  if (strcmp (argv[1], "write") == 0)
  {
    dds_entity_t writer = dds_create_writer (participant, topic, qos, NULL);
    printf ("ready\n");
    dds_publication_matched_status_t matched;
    do { dds_sleepfor (DDS_MSECS (5)); dds_get_publication_matched_status (writer, &matched); }
    while (!durable && matched.current_count == 0);
    if (strcmp (argv[5], "when_told") == 0) { for (int c = 0; c != EOF && c != '\n'; ) c = getchar (); }
    for (int i = 0; i < count; i++)
    {
      char text[32];
      snprintf (text, sizeof text, "hello %d", i);
      HelloWorldData_Msg message = { .userID = i, .message = text };
      if (dds_write (writer, &message) < 0) { printf ("not written\n"); return 1; }
    }
    printf ("wrote\n");
  }
  else
  {
    dds_entity_t reader = dds_create_reader (participant, topic, qos, NULL);
    printf ("ready\n");
    for (int seen = 0; seen < count; )
    {
      void *samples[1] = { NULL };
      dds_sample_info_t info[1];
      if (dds_take (reader, samples, info, 1, 1) == 1)
      {
        const HelloWorldData_Msg *message = samples[0];
        if (info[0].valid_data) { printf ("got %d %s\n", message->userID, message->message); seen++; }
        dds_return_loan (reader, samples, 1);
      }
      else dds_sleepfor (DDS_MSECS (2));
    }
  }
  while (getchar () != EOF) { }
  dds_delete_qos (qos);
  dds_delete (participant);
  return 0;
}
