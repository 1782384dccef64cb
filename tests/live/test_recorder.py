"""The recorder between sources and the journal."""

import asyncio

from gpszip.live import Fix, Journal, Notices, Recorder


def test_senders_are_answered_whatever_fails_once_their_fixes_are_on_disk(tmp_path):
    class Failing(Notices):
        def count(self, what, number=1):
            raise ValueError("a fault of what tells")

    async def store_both(recorder):
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        for time in (1.7e9, 1.8e9):
            async with asyncio.timeout(30):
                await recorder.store([Fix("bus", "test", time, time, (48.0, 11.5))])

    journal = Journal(tmp_path)
    asyncio.run(store_both(Recorder(journal, Failing(print))))
    assert [fix.time for fix in journal.recent()] == [1.7e9, 1.8e9]
    journal.close()
